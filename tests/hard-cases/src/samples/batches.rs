//! Many samples at once against one by one.

use super::cores::regularity;
use super::decompositions::{beyond, distance_from_rotation};
use super::draws::{Draw, exponent, ordinary_actuation, ordinary_deformation, scaled, times_power};
use super::tally::Tally;
use super::{CORES, finite};
use nalgebra::Matrix3;
use polar_grad::testing::Random;
use polar_grad::{Filter, HessianCore, RotationGradient, batch, polar_rotation, symmetric_entries};

/// Between so many of a class comes one that is easy.
const EASY: usize = 3;

/// The answers of all batched functions.
#[derive(PartialEq)]
struct Answers {
    alone: Vec<Matrix3<f64>>,
    rotations: Vec<Matrix3<f64>>,
    sums: Vec<[f64; 6]>,
    factors: Vec<[f64; 6]>,
    projected: Vec<[f64; 6]>,
    products: Vec<Matrix3<f64>>,
}

struct Batch {
    m: Vec<Matrix3<f64>>,
    a: Vec<Matrix3<f64>>,
    tangents: Vec<Matrix3<f64>>,
    numbers: Vec<u64>,
}

impl Batch {
    fn answers(&self, range: std::ops::Range<usize>) -> Answers {
        let m = &self.m[range.clone()];
        let n = m.len();
        let mut alone = vec![Matrix3::zeros(); n];
        batch::polar_rotations(m, &mut alone);
        let mut rotations = alone.clone();
        let [mut sums, mut factors, mut projected] = [(); 3].map(|()| vec![[0.0; 6]; n]);
        batch::factors(m, &mut rotations, &mut sums, &mut factors);
        let a: Vec<_> = self.a[range.clone()]
            .iter()
            .map(symmetric_entries)
            .collect();
        batch::projected_factors(&sums, &a, &mut projected);
        let mut products = alone.clone();
        batch::hessian_products(&rotations, &factors, &self.tangents[range], &mut products);
        Answers {
            alone,
            rotations,
            sums,
            factors,
            projected,
            products,
        }
    }
}

fn full(x: &[f64; 6]) -> Matrix3<f64> {
    Matrix3::new(x[0], x[1], x[2], x[1], x[3], x[4], x[2], x[4], x[5])
}

/// The largest entry of a difference, relative to the largest of the second.
fn relative(x: &Matrix3<f64>, expected: &Matrix3<f64>) -> f64 {
    let e = exponent(expected);
    let (x, expected) = (scaled(x, -e), scaled(expected, -e));
    (x - expected).amax() / expected.amax().max(f64::MIN_POSITIVE)
}

pub fn check(tally: &mut Tally, first: u64, draws: &[Draw]) {
    let mut random = Random::new(first);
    let mut all = Batch {
        m: Vec::new(),
        a: Vec::new(),
        tangents: Vec::new(),
        numbers: Vec::new(),
    };
    for (i, draw) in draws.iter().enumerate() {
        let easy = i % EASY == 0;
        let number = first + i as u64;
        let mut push = |m, a, size: i32| {
            all.m.push(m);
            all.a.push(a);
            all.tangents.push(scaled(&draw.tangents[0], size));
            all.numbers.push(number);
        };
        push(draw.m, draw.a, exponent(&draw.m).clamp(-900, 900));
        if easy {
            let m = ordinary_deformation(&mut random);
            push(m, ordinary_actuation(&mut random), 0);
        }
    }
    let n = all.m.len();
    let whole = all.answers(0..n);
    for i in 0..n {
        one(tally, &all, &whole, i);
    }
    // Some of them alone: no answer depends on its neighbours or its place.
    let length = (1 + (random.bits() % 17) as usize).min(n);
    let start = (random.bits() % (n - length + 1) as u64) as usize;
    let range = start..start + length;
    let part = Answers {
        alone: whole.alone[range.clone()].to_vec(),
        rotations: whole.rotations[range.clone()].to_vec(),
        sums: whole.sums[range.clone()].to_vec(),
        factors: whole.factors[range.clone()].to_vec(),
        projected: whole.projected[range.clone()].to_vec(),
        products: whole.products[range.clone()].to_vec(),
    };
    let same = part == all.answers(range);
    tally.require(first, "batch: neighbours do not matter", same);
}

fn one(tally: &mut Tally, all: &Batch, out: &Answers, i: usize) {
    let (m, number) = (&all.m[i], all.numbers[i]);
    let r = &out.rotations[i];
    let gradient = RotationGradient::at(m);
    let e = exponent(m);
    let unit = scaled(m, -e);
    let gap = times_power(gradient.smallest_pair_sum, -e) / unit.amax().max(f64::MIN_POSITIVE);

    tally.require(number, "batch: the same R twice", out.alone[i] == *r);
    let off = distance_from_rotation(r);
    tally.check(number, "batch: R in SO(3)", off, 5e-15);
    let scalar = polar_rotation(m);
    let lost = (scalar.dot(&unit) - r.dot(&unit)).max(0.0);
    tally.check(number, "batch: no rotation is nearer", lost, 2e-14);
    if gap > 1e-9 {
        let error = (r - scalar).amax() / (1.0 + 1.0 / gap);
        tally.check(number, "batch: R as one by one", error, 1e-14);
    }

    let (sums, factor) = (full(&out.sums[i]), full(&out.factors[i]));
    tally.require(
        number,
        "batch: derivative finite",
        finite(&sums) && finite(&factor) && finite(&out.products[i]),
    );
    let condition = 1.0 + 1.0 / gap.max(polar_grad::PAIR_SUM_FLOOR);
    let rounding = times_power(1.0, -1074 - e).min(1.0);
    let error = beyond(relative(&sums, &gradient.pair_sums), rounding) / condition;
    tally.check(number, "batch: T as one by one", error, 1e-14);
    let error = relative(&factor, &gradient.factor) / condition;
    tally.check(number, "batch: B as one by one", error, 2e-14);
    // The same numbers multiplied, by lanes and by hand.
    let given = RotationGradient {
        rotation: *r,
        factor,
        ..gradient
    };
    let product = given.apply(&all.tangents[i]);
    let size = factor.amax() * all.tangents[i].amax();
    let error = (out.products[i] - product).amax() / size.max(f64::MIN_POSITIVE);
    tally.check(number, "batch: products as one by one", error, 1e-14);

    let a = &all.a[i];
    if !finite(&(a * a)) {
        return;
    }
    let projected = full(&out.projected[i]);
    tally.require(number, "batch: projection finite", finite(&projected));
    if !number.is_multiple_of(CORES) {
        return;
    }
    // At the lane's own rotation and sums, so that only the projection is compared.
    let exact = HessianCore {
        gradient: RotationGradient {
            rotation: *r,
            factor,
            pair_sums: sums,
            smallest_pair_sum: gradient.smallest_pair_sum,
        },
        actuation: *a,
        filter: Filter::Exact,
    };
    let x = scaled(&all.tangents[i], -exponent(&all.tangents[i]));
    let by_lanes = HessianCore {
        gradient: RotationGradient {
            factor: projected,
            ..exact.gradient
        },
        ..exact
    };
    let y = by_lanes.apply(&x);
    tally.require(number, "batch: products with C+ finite", finite(&y));
    let regularity = regularity(&exact);
    if regularity > 1e-7 {
        let error = (y - exact.filtered(Filter::Projected).apply(&x)).amax();
        // A definite core keeps its own factor, which is known to rounding over its gap.
        let condition = 1.0 + 2e-3 / regularity + 1.0 / gap.max(1e-3);
        tally.check(number, "batch: C+ as one by one", error / condition, 1e-13);
    }
    let quadratic = y.dot(&x) / x.norm_squared();
    let slack = if regularity > 1e-4 { 1e-12 } else { 1e-6 };
    let low = (-quadratic).max(quadratic - 1.0);
    let low = beyond(if low < 0.0 { 0.0 } else { low }, slack);
    tally.check(number, "batch: 0 <= C+ <= I", low, 0.0);
}
