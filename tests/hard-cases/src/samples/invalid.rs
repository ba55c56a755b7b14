//! Entries that are no numbers, and products that are none any more.

use super::draws::{ordinary_actuation, ordinary_deformation};
use super::finite;
use super::tally::Tally;
use crate::case::{Case, Effort, Section};
use nalgebra::Matrix3;
use polar_grad::testing::Random;
use polar_grad::{
    RotationGradient, batch, polar, polar_rotation, shape_targeting_gradient, signed_svd,
    symmetric_entries,
};

/// Whether no entry is a number.
fn nan(m: &Matrix3<f64>) -> bool {
    m.iter().all(|x| x.is_nan())
}

/// Where `F A` overflows there is no rotation: nothing may pretend that there is.
pub fn stays_a_number_or_none(tally: &mut Tally, number: u64, f: &Matrix3<f64>, a: &Matrix3<f64>) {
    let gradient = shape_targeting_gradient(f, a);
    tally.require(number, "an overflow shows", !finite(&gradient));
}

/// The case of entries that are infinite or no numbers.
pub fn case() -> Case {
    Case::new(
        Section::Samples,
        "sample not a number",
        "one entry infinite or not a number: nothing but NaN comes out, and no neighbour in a batch notices",
        |effort: &Effort| {
            // All together, a dozen at a time.
            let draws = (effort.draws / 100).max(100);
            let mut tally = Tally::default();
            for number in 0..draws as u64 {
                check(&mut tally, number);
            }
            let mut finding = tally.finding(draws);
            finding.notes.clear();
            finding
        },
    )
}

fn check(tally: &mut Tally, number: u64) {
    let mut random = Random::new(Random::new(number).bits());
    let r = &mut random;
    let count = 1 + (r.bits() % 19) as usize;
    let place = (r.bits() % count as u64) as usize;
    let clean: Vec<Matrix3<f64>> = (0..count).map(|_| ordinary_deformation(r)).collect();
    let actuations: Vec<[f64; 6]> = (0..count)
        .map(|_| symmetric_entries(&ordinary_actuation(r)))
        .collect();
    let tangents: Vec<Matrix3<f64>> = (0..count).map(|_| r.matrix()).collect();
    let mut spoilt = clean.clone();
    let wrong = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY][(r.bits() % 3) as usize];
    spoilt[place][(r.bits() % 9) as usize] = wrong;
    let m = &spoilt[place];

    let svd = signed_svd(m);
    let none = nan(&svd.u) && nan(&svd.v) && svd.sigma.iter().all(|x| x.is_nan());
    tally.require(number, "signed_svd is NaN", none);
    tally.require(number, "polar_rotation is NaN", nan(&polar_rotation(m)));
    let polar = polar(m);
    tally.require(
        number,
        "polar is NaN",
        nan(&polar.rotation) && nan(&polar.stretch),
    );
    let g = RotationGradient::at(m);
    tally.require(
        number,
        "derivative is NaN",
        nan(&g.rotation) && nan(&g.factor) && nan(&g.pair_sums) && g.smallest_pair_sum.is_nan(),
    );

    let answer = |m: &[Matrix3<f64>]| {
        let mut rotations = vec![Matrix3::zeros(); count];
        let [mut sums, mut factors, mut projected] = [(); 3].map(|()| vec![[0.0; 6]; count]);
        let mut products = rotations.clone();
        batch::factors(m, &mut rotations, &mut sums, &mut factors);
        batch::projected_factors(&sums, &actuations, &mut projected);
        batch::hessian_products(&rotations, &projected, &tangents, &mut products);
        (rotations, sums, factors, projected, products)
    };
    let (before, after) = (answer(&clean), answer(&spoilt));
    let mut same = true;
    let mut none = true;
    for i in 0..count {
        if i == place {
            let six = [&after.1, &after.2, &after.3];
            none = nan(&after.0[i])
                && nan(&after.4[i])
                && six.iter().all(|x| x[i].iter().all(|x| x.is_nan()));
        } else {
            same &= before.0[i] == after.0[i]
                && before.1[i] == after.1[i]
                && before.2[i] == after.2[i]
                && before.3[i] == after.3[i]
                && before.4[i] == after.4[i];
        }
    }
    tally.require(number, "its place in a batch is NaN", none);
    tally.require(number, "neighbours in a batch stay", same);
}
