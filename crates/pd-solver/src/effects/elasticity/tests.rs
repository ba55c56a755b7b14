//! The lanes against plain sums over elements, samples and corners, and against themselves on other threads and other instruction
//! sets.

use super::plain::deformation_gradient;
use super::*;
use crate::vector::{max_norm, zeros};
use hex_mesh::{QuadratureRule, trilinear_gradients};
use polar_grad::{HessianCore, actuation_from_b, actuation_vjp};

/// Numbers between -1 and 1, the same in every run.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn vectors(&mut self, count: usize, size: f64) -> NodalVector {
        (0..count)
            .map(|_| Vector3::from_fn(|_, _| self.next() * size))
            .collect()
    }
}

/// A body, its parameters, a state and a direction.
struct Case {
    elements: Vec<[u32; 8]>,
    sizes: Vec<Vector3<f64>>,
    weights: Vec<f64>,
    quadrature: Quadrature,
    parameters: Parameters,
    u: NodalVector,
    z: NodalVector,
}

/// What the effect computes: energy, gradient, Hessian product, derivative by the actuation, smallest pair sum.
#[derive(Debug, PartialEq)]
struct Answers {
    energy: f64,
    gradient: NodalVector,
    product: NodalVector,
    actuation: Vec<[f64; 6]>,
    smallest: f64,
}

impl Case {
    /// Boxes of various sizes and weights in a row of unit cubes, each with a face in common with the next, strongly deformed.
    fn row(count: usize, quadrature: Quadrature) -> Self {
        let mut numbers = Numbers(count as u64 + 40);
        let elements = (0..count as u32)
            .map(|e| std::array::from_fn(|c| 4 * e + c as u32))
            .collect();
        let sizes = (0..count)
            .map(|_| Vector3::from_fn(|_, _| 1.1 + 0.5 * numbers.next()))
            .collect();
        let weights = (0..count).map(|_| 2.0 + numbers.next()).collect();
        let noise = numbers.vectors(4 * count + 4, 0.3);
        let corner = |(n, noise): (usize, &Vector3<f64>)| {
            noise + Vector3::new((n / 4) as f64, (n / 2 % 2) as f64, (n % 2) as f64)
        };
        let u = noise.iter().enumerate().map(corner).collect();
        Self::with(elements, sizes, weights, quadrature, u, &mut numbers)
    }

    /// A box of cubes, of several slabs.
    fn solid(cells: [usize; 3], quadrature: Quadrature) -> Self {
        let mut numbers = Numbers(7);
        let mesh = HexMesh::solid_box(cells, 0.5, quadrature).unwrap();
        let body = ElasticBody::from_mesh(&mesh, 3.0, None);
        let noise = numbers.vectors(mesh.nodes().len(), 0.1);
        let u = mesh
            .nodes()
            .iter()
            .zip(noise)
            .map(|(x, noise)| x + noise)
            .collect();
        Self::with(
            body.elements,
            body.sizes,
            body.weights,
            quadrature,
            u,
            &mut numbers,
        )
    }

    fn with(
        elements: Vec<[u32; 8]>,
        sizes: Vec<Vector3<f64>>,
        weights: Vec<f64>,
        quadrature: Quadrature,
        u: NodalVector,
        numbers: &mut Numbers,
    ) -> Self {
        let samples = elements.len() * quadrature.count();
        let actuation = (0..samples)
            .map(|_| std::array::from_fn(|_| 0.3 * numbers.next()))
            .collect();
        let parameters = Parameters {
            actuation,
            ..Parameters::default()
        };
        let z = numbers.vectors(u.len(), 1.0);
        Self {
            elements,
            sizes,
            weights,
            quadrature,
            parameters,
            u,
            z,
        }
    }

    fn effect(&self) -> Elasticity {
        let mut effect = Elasticity::new(ElasticBody {
            elements: self.elements.clone(),
            sizes: self.sizes.clone(),
            weights: self.weights.clone(),
            quadrature: self.quadrature,
            node_count: self.u.len(),
        });
        effect.set_parameters(&self.parameters);
        effect
    }

    fn by_lanes(&self, effect: &mut Elasticity) -> Answers {
        let mut gradient = zeros(self.u.len());
        let mut product = gradient.clone();
        let mut vjp = Parameters::default();
        vjp.begin_gradient(&self.parameters);
        // What was there before does not matter.
        vjp.actuation.fill([7.0; 6]);
        let energy = effect.energy_gradient(&self.u, &mut gradient);
        effect.linearise(&self.u);
        effect.hessian_product(&self.z, &mut product);
        effect.parameter_vjp(&self.u, &self.z, &mut vjp);
        let smallest = effect.smallest_pair_sum().unwrap();
        let at_once = self.with_gradient_at_once(effect);
        assert!(gradient == at_once.0 && product == at_once.1);
        assert!((at_once.2 - smallest).abs() <= 1e-11 * smallest);
        Answers {
            energy,
            gradient,
            product,
            actuation: vjp.actuation,
            smallest,
        }
    }

    /// Gradient, Hessian product and smallest pair sum where the gradient is asked for along with the linearisation.
    fn with_gradient_at_once(&self, effect: &mut Elasticity) -> (NodalVector, NodalVector, f64) {
        // Elsewhere before, so that nothing is left over from the last linearisation.
        effect.linearise(&self.z);
        let mut gradient = zeros(self.u.len());
        let mut product = gradient.clone();
        effect.linearise_with_gradient(&self.u, &mut gradient);
        effect.hessian_product(&self.z, &mut product);
        (gradient, product, effect.smallest_pair_sum().unwrap())
    }

    /// Sample by sample, with the dense gradient operator (maths.md).
    fn plainly(&self) -> Answers {
        let rule = QuadratureRule::new(self.quadrature);
        let mut out = Answers {
            energy: 0.0,
            gradient: zeros(self.u.len()),
            product: zeros(self.u.len()),
            actuation: Vec::new(),
            smallest: f64::INFINITY,
        };
        for (e, nodes) in self.elements.iter().enumerate() {
            let u = nodes.map(|n| self.u[n as usize]);
            let z = nodes.map(|n| self.z[n as usize]);
            for (q, point) in rule.points.iter().enumerate() {
                let weight = self.weights[e] * rule.weights[q];
                let g = trilinear_gradients(point).map(|g| g.component_div(&self.sizes[e]));
                let a = actuation_from_b(&self.parameters.actuation[e * rule.len() + q]);
                let (f, d_f) = (deformation_gradient(&u, &g), deformation_gradient(&z, &g));
                let core = HessianCore::new(&f, &a);
                let misfit = f - core.gradient.rotation * a;
                out.energy += 0.5 * weight * misfit.norm_squared();
                for (n, g) in nodes.iter().zip(&g) {
                    out.gradient[*n as usize] += misfit * g * weight;
                    out.product[*n as usize] += core.apply(&d_f) * g * weight;
                }
                out.actuation
                    .push(actuation_vjp(&core, &f, &d_f).map(|x| weight * x));
                out.smallest = out.smallest.min(core.gradient.smallest_pair_sum);
            }
            if self.quadrature == Quadrature::One {
                self.add_hourglass(e, &u, &z, &mut out);
            }
        }
        out
    }

    /// `|F|^2` by eight samples less `|F|^2` by one: what the modes add, without a word of modes.
    fn add_hourglass(
        &self,
        e: usize,
        u: &[Vector3<f64>; 8],
        z: &[Vector3<f64>; 8],
        out: &mut Answers,
    ) {
        for (rule, sign) in [(Quadrature::Eight, 1.0), (Quadrature::One, -1.0)] {
            let rule = QuadratureRule::new(rule);
            for (point, weight) in rule.points.iter().zip(&rule.weights) {
                let weight = sign * weight * self.weights[e];
                let g = trilinear_gradients(point).map(|g| g.component_div(&self.sizes[e]));
                let (f, d_f) = (deformation_gradient(u, &g), deformation_gradient(z, &g));
                out.energy += 0.5 * weight * f.norm_squared();
                for (n, g) in self.elements[e].iter().zip(&g) {
                    out.gradient[*n as usize] += f * g * weight;
                    out.product[*n as usize] += d_f * g * weight;
                }
            }
        }
    }
}

fn assert_close(a: &Answers, b: &Answers, what: &str) {
    let close = |a: f64, b: f64, name: &str| {
        assert!(
            (a - b).abs() < 1e-11 * (1.0 + b.abs()),
            "{what}: {name} {a} {b}"
        );
    };
    close(a.energy, b.energy, "energy");
    close(a.smallest, b.smallest, "smallest pair sum");
    assert_eq!(a.actuation.len(), b.actuation.len());
    for (a, b) in a
        .actuation
        .as_flattened()
        .iter()
        .zip(b.actuation.as_flattened())
    {
        close(*a, *b, "derivative by the actuation");
    }
    for (name, a, b) in [
        ("gradient", &a.gradient, &b.gradient),
        ("product", &a.product, &b.product),
    ] {
        for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
            close(*a, *b, name);
        }
    }
}

const RULES: [Quadrature; 3] = [Quadrature::One, Quadrature::Eight, Quadrature::TwentySeven];

#[test]
fn lanes_agree_with_plain_sums() {
    let rows = |quadrature| (1..=17).map(move |count| Case::row(count, quadrature));
    let solid = [
        Case::solid([12, 5, 7], Quadrature::Eight),
        Case::solid([9, 6, 4], Quadrature::One),
    ];
    for case in RULES.into_iter().flat_map(rows).chain(solid) {
        let what = format!("{} elements, {:?}", case.elements.len(), case.quadrature);
        assert_close(&case.by_lanes(&mut case.effect()), &case.plainly(), &what);
    }
}

#[test]
fn instruction_sets_agree() {
    let mut sets = vec![Arch::Scalar];
    #[cfg(target_arch = "x86_64")]
    sets.extend(pulp::x86::V3::try_new().map(Arch::V3));
    for quadrature in RULES {
        let case = Case::row(13, quadrature);
        for &arch in &sets {
            let mut effect = case.effect();
            effect.arch = arch;
            assert_close(
                &case.by_lanes(&mut effect),
                &case.plainly(),
                &format!("{quadrature:?}"),
            );
        }
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    for quadrature in RULES {
        let case = Case::solid([17, 9, 8], quadrature);
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| case.by_lanes(&mut case.effect()))
        };
        assert_eq!(on(1), on(3));
    }
}

/// The smallest pair sum is found wherever it is, also where it is so small that B was raised, and without the lanes that only
/// fill a block.
#[test]
fn smallest_pair_sum_is_that_of_one_planted_sample() {
    for planted in [1.0, 0.3, 1e-3, 1e-9, 1e-13, 0.0] {
        for element in [0, 4, 10] {
            let mut case = Case::row(11, Quadrature::Eight);
            // Every element at rest but for the actuation of one, whose pair sums are 4, 2 + p and p.
            case.sizes.fill(Vector3::repeat(1.0));
            for (n, u) in case.u.iter_mut().enumerate() {
                *u = Vector3::new((n / 4) as f64, (n / 2 % 2) as f64, (n % 2) as f64);
            }
            case.parameters.actuation.fill([0.0; 6]);
            let b = [2.0, 0.0, 0.0, 0.0, 0.0, planted - 2.0];
            case.parameters.actuation[8 * element + 3] = b;
            let found = case.by_lanes(&mut case.effect()).smallest;
            assert!((found - planted).abs() < 1e-14, "{planted} {found}");
        }
    }
}

/// One sample plus the modes is full integration, entry by entry, in any box.
#[test]
fn modes_complete_the_constant_block() {
    let inverse2 = [1.0, 4.0, 0.3];
    let sum = |axes: [[[f64; 8]; 8]; 3]| {
        let mut block = [[0.0; 8]; 8];
        for (axis, inverse2) in axes.iter().zip(inverse2) {
            for (entry, x) in block.as_flattened_mut().iter_mut().zip(axis.as_flattened()) {
                *entry += inverse2 * x;
            }
        }
        block
    };
    let mut completed = sum(constant_blocks(Quadrature::One));
    hourglass::add_to_constant(inverse2, &mut completed);
    let full = sum(constant_blocks(Quadrature::Eight));
    for (a, b) in completed.as_flattened().iter().zip(full.as_flattened()) {
        assert!((a - b).abs() < 1e-14);
    }
}

/// At rest, or near it, or not: the same energy and gradient as by rotations, whether A is positive definite or not.
#[test]
fn evaluations_at_rest_are_evaluations() {
    let mut case = Case::solid([4, 5, 7], Quadrature::Eight);
    let mesh = HexMesh::solid_box([4, 5, 7], 0.5, Quadrature::Eight).unwrap();
    let bend = |x: &Vector3<f64>| x + Vector3::new(0.0, 0.3 * x.x * x.x, 0.0);
    let bent = |from: f64| -> NodalVector {
        let nodes = mesh.nodes().iter();
        nodes
            .map(|x| if x.z > from { bend(x) } else { *x })
            .collect()
    };
    let far = |shift: f64| -> NodalVector {
        let nodes = mesh.nodes().iter();
        nodes.map(|x| x + Vector3::repeat(shift)).collect()
    };
    for (name, u) in [
        ("rest", far(0.0)),
        ("far", far(1e3)),
        ("in part", bent(1.6)),
        ("bent", bent(-1.0)),
    ] {
        for indefinite in [false, true] {
            case.u.copy_from_slice(&u);
            if indefinite {
                for b in case.parameters.actuation.iter_mut().step_by(13) {
                    b[3] = -1.5;
                }
            }
            let mut effect = case.effect();
            let (mut expected, mut gradient) = (zeros(u.len()), zeros(u.len()));
            let energy = effect.energy_gradient(&u, &mut expected);
            let at_rest = effect.energy_gradient_at_rest(&u, &mut gradient);
            assert!(
                (at_rest - energy).abs() < 1e-11 * energy,
                "{name}: {at_rest} {energy}"
            );
            let error = gradient.iter().zip(&expected).map(|(a, b)| (a - b).norm());
            let (error, size) = (error.fold(0.0, f64::max), max_norm(&expected));
            assert!(
                error < 1e-9 * size,
                "{name}, indefinite {indefinite}: {error:e} of {size:e}"
            );
        }
    }
}

/// Lanes gather by the nodes of elements, so an array that has more than those would not be noticed otherwise.
#[test]
#[should_panic(expected = "one vector per node")]
fn a_vector_too_many_is_refused() {
    let case = Case::row(3, Quadrature::Eight);
    let mut u = case.u.clone();
    u.push(Vector3::zeros());
    let mut gradient = zeros(case.u.len());
    case.effect().energy_gradient(&u, &mut gradient);
}

/// By lanes as many samples are inside out as have a negative determinant one by one; of lanes that hold no element none is.
#[test]
fn inverted_samples_are_those_with_a_negative_determinant() {
    for quadrature in [Quadrature::One, Quadrature::Eight, Quadrature::TwentySeven] {
        let case = Case::row(21, quadrature);
        let rule = QuadratureRule::new(quadrature);
        let mut effect = case.effect();
        // Random positions turn about half of the samples inside out.
        for (u, some) in [(&case.u, false), (&case.z, true)] {
            let mut count = 0;
            for (nodes, size) in case.elements.iter().zip(&case.sizes) {
                let corners = nodes.map(|n| u[n as usize]);
                let determinant = |point: &_| {
                    let g = trilinear_gradients(point).map(|g| g.component_div(size));
                    deformation_gradient(&corners, &g).determinant()
                };
                count += rule.points.iter().filter(|p| determinant(p) < 0.0).count();
            }
            assert!(!some || (count > 0 && count < 21 * rule.len()));
            assert_eq!(effect.inverted_samples(u), count, "{}", rule.len());
            effect.energy_gradient(u, &mut zeros(u.len()));
            assert_eq!(effect.inverted_where_evaluated(), count, "{}", rule.len());
        }
    }
}

/// Where F and A are the same all over an element, its middle tells the change of the gradient to the last digit, hourglass modes or not; and
/// parameters that were never remembered, or are those again, have changed nothing.
#[test]
fn the_change_of_the_gradient_is_that_by_the_actuation() {
    for quadrature in [Quadrature::One, Quadrature::Eight, Quadrature::TwentySeven] {
        let mut case = Case::solid([7, 3, 2], quadrature);
        let mut numbers = Numbers(8);
        let f = nalgebra::Matrix3::from_fn(|i, j| f64::from(i == j) + 0.3 * numbers.next());
        let mesh = HexMesh::solid_box([7, 3, 2], 0.5, quadrature).unwrap();
        case.u = mesh.nodes().iter().map(|x| f * x).collect();
        let samples = quadrature.count();
        let mut uniform = |size: f64| -> Vec<[f64; 6]> {
            (0..case.elements.len())
                .flat_map(|_| vec![std::array::from_fn(|_| size * numbers.next()); samples])
                .collect()
        };
        case.parameters.actuation = uniform(0.3);
        let (n, mut effect) = (case.u.len(), case.effect());
        let (mut before, mut after, mut change) = (zeros(n), zeros(n), zeros(n));
        assert!(!effect.add_gradient_change(&case.u, &mut change));
        effect.energy_gradient(&case.u, &mut before);
        effect.remember_parameters();
        effect.set_parameters(&case.parameters);
        assert!(!effect.add_gradient_change(&case.u, &mut change));
        assert_eq!(max_norm(&change), 0.0);
        case.parameters.actuation = uniform(0.2);
        // What comes between does not matter.
        effect.set_parameters(&case.parameters);
        case.parameters.actuation = uniform(0.2);
        effect.set_parameters(&case.parameters);
        effect.energy_gradient(&case.u, &mut after);
        assert!(effect.add_gradient_change(&case.u, &mut change));
        let worst = (0..n).map(|i| (after[i] - before[i] - change[i]).norm());
        let worst = worst.fold(0.0, f64::max);
        assert!(worst < 1e-13 * max_norm(&change), "{samples}: {worst}");
    }
}

/// One entry that is not finite is seen, in any sample and lane.
#[test]
fn an_actuation_that_is_not_finite_is_seen() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for at in [0, 8, 63, 70, 167] {
            let mut case = Case::row(21, Quadrature::Eight);
            assert!(case.effect().actuation_is_finite());
            case.parameters.actuation[at][at % 6] = bad;
            assert!(!case.effect().actuation_is_finite(), "{bad} at {at}");
        }
    }
}
