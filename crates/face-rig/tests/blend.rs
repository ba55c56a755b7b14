//! Blend weights against planted answers, the optimality conditions and an interior-point solver.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT};
use face_rig::{Activity, BlendBasis, BlendFit, Bounds, RIDGE, RigError};
use nalgebra::Vector3;
use proptest::prelude::*;

type Shape = Vec<Vector3<f64>>;

/// Deterministic numbers in -1 to 1 from splitmix64.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((bits ^ (bits >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn shape(&mut self, vertices: usize) -> Shape {
        (0..vertices)
            .map(|_| Vector3::from_fn(|_, _| self.next()))
            .collect()
    }

    fn shapes(&mut self, count: usize, vertices: usize) -> Vec<Shape> {
        (0..count).map(|_| self.shape(vertices)).collect()
    }
}

fn combine(shapes: &[Shape], weights: &[f64]) -> Shape {
    (0..shapes[0].len())
        .map(|vertex| {
            shapes
                .iter()
                .zip(weights)
                .map(|(shape, weight)| shape[vertex] * *weight)
                .sum()
        })
        .collect()
}

fn inner(a: &Shape, b: &Shape) -> f64 {
    a.iter().zip(b).map(|(a, b)| a.dot(b)).sum()
}

fn mean_square(shapes: &[Shape]) -> f64 {
    shapes.iter().map(|shape| inner(shape, shape)).sum::<f64>() / shapes.len() as f64
}

/// Half the slope of the objective in each weight.
fn slopes(shapes: &[Shape], target: &Shape, weights: &[f64], regularisation: f64) -> Vec<f64> {
    let reached = combine(shapes, weights);
    let rest: Shape = reached.iter().zip(target).map(|(a, b)| a - b).collect();
    let ridge = (regularisation + RIDGE) * mean_square(shapes);
    shapes
        .iter()
        .zip(weights)
        .map(|(shape, weight)| inner(shape, &rest) + ridge * weight)
        .collect()
}

/// The Karush-Kuhn-Tucker conditions: feasible, no slope where free, slope outwards at a bound.
fn assert_optimal(
    shapes: &[Shape],
    target: &Shape,
    bounds: &Bounds,
    regularisation: f64,
    fit: &BlendFit,
) {
    assert!(fit.converged, "{fit:?}");
    let slopes = slopes(shapes, target, &fit.weights, regularisation);
    let size = inner(target, target).sqrt().max(1e-300);
    for (index, slope) in slopes.iter().enumerate() {
        let weight = fit.weights[index];
        let (lower, upper) = (bounds.lower[index], bounds.upper[index]);
        assert!(
            lower <= weight && weight <= upper,
            "weight {index} = {weight} outside {lower}..{upper}"
        );
        let relative = slope / (size * inner(&shapes[index], &shapes[index]).sqrt().max(1e-300));
        match fit.activity[index] {
            Activity::Free => assert!(
                relative.abs() < 1e-10,
                "free weight {index} has slope {relative}"
            ),
            Activity::Lower => assert!(
                weight == lower && (relative > -1e-10 || lower == upper),
                "{index}: {relative}"
            ),
            Activity::Upper => assert!(
                weight == upper && (relative < 1e-10 || lower == upper),
                "{index}: {relative}"
            ),
        }
    }
}

/// The same program solved by an interior-point method.
fn oracle(shapes: &[Shape], target: &Shape, bounds: &Bounds, regularisation: f64) -> Vec<f64> {
    let count = shapes.len();
    let ridge = (regularisation + RIDGE) * mean_square(shapes);
    let (mut pointers, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
    for column in 0..count {
        for row in 0..=column {
            rows.push(row);
            values.push(
                inner(&shapes[row], &shapes[column]) + if row == column { ridge } else { 0.0 },
            );
        }
        pointers.push(rows.len());
    }
    let quadratic = CscMatrix::new(count, count, pointers, rows, values);
    let linear: Vec<f64> = shapes.iter().map(|shape| -inner(shape, target)).collect();
    let box_rows = CscMatrix::new(
        2 * count,
        count,
        (0..=count).map(|column| 2 * column).collect(),
        (0..count)
            .flat_map(|column| [column, count + column])
            .collect(),
        [1.0, -1.0].repeat(count),
    );
    let limits: Vec<f64> = bounds
        .upper
        .iter()
        .copied()
        .chain(bounds.lower.iter().map(|lower| -lower))
        .collect();
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .tol_gap_abs(1e-12)
        .tol_gap_rel(1e-12)
        .tol_feas(1e-12)
        .build()
        .unwrap();
    let cones = [NonnegativeConeT(2 * count)];
    let mut solver =
        DefaultSolver::new(&quadratic, &linear, &box_rows, &limits, &cones, settings).unwrap();
    solver.solve();
    solver.solution.x
}

fn objective(shapes: &[Shape], target: &Shape, weights: &[f64], regularisation: f64) -> f64 {
    let rest: Shape = combine(shapes, weights)
        .iter()
        .zip(target)
        .map(|(a, b)| a - b)
        .collect();
    let ridge = (regularisation + RIDGE) * mean_square(shapes);
    inner(&rest, &rest) + ridge * weights.iter().map(|weight| weight * weight).sum::<f64>()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn planted_weights_are_recovered(seed: u64, count in 1_usize..20) {
        let mut noise = Noise(seed);
        let shapes = noise.shapes(count, 30);
        let planted: Vec<f64> = (0..count).map(|_| noise.next().clamp(-0.5, 0.5) + 0.5).collect();
        let fit = BlendBasis::new(shapes.clone()).unwrap()
            .fit(&combine(&shapes, &planted), &Bounds::uniform(count, 0.0, 1.0), 0.0).unwrap();
        for (found, wanted) in fit.weights.iter().zip(&planted) {
            prop_assert!((found - wanted).abs() < 1e-9, "{:?} {:?}", fit.weights, planted);
        }
        prop_assert!(fit.residual_rms < 1e-9);
    }

    #[test]
    fn fits_meet_the_optimality_conditions(
        seed: u64, count in 1_usize..30, vertices in 1_usize..25, repeated in 0_usize..5, regular in prop::bool::ANY,
    ) {
        let mut noise = Noise(seed);
        let mut shapes = noise.shapes(count, vertices);
        for index in 0..repeated.min(count) {
            shapes.push(shapes[index].clone());
        }
        let target: Shape = noise.shape(vertices).iter().map(|v| v * 3.0).collect();
        let mut bounds = Bounds::uniform(shapes.len(), 0.0, 1.0);
        for index in 0..shapes.len() {
            match (noise.next() * 4.0) as i32 {
                3 => bounds.upper[index] = f64::INFINITY,
                -3 => bounds.lower[index] = -0.3,
                2 => bounds.upper[index] = 0.0,
                -2 => { bounds.lower[index] = -0.4; bounds.upper[index] = -0.1; }
                _ => {}
            }
        }
        let regularisation = if regular { 1e-3 } else { 0.0 };
        let fit = BlendBasis::new(shapes.clone()).unwrap().fit(&target, &bounds, regularisation).unwrap();
        assert_optimal(&shapes, &target, &bounds, regularisation, &fit);
    }
}

#[test]
fn fits_agree_with_an_interior_point_solver() {
    let mut noise = Noise(7);
    let mut bound_total = 0;
    for round in 0..30 {
        let count = 5 + round;
        let shapes = noise.shapes(count, 40);
        let target: Shape = noise.shape(40).iter().map(|v| v * 4.0).collect();
        let bounds = Bounds::uniform(count, 0.0, 0.4);
        let regularisation = if round % 2 == 0 { 0.0 } else { 1e-2 };
        let fit = BlendBasis::new(shapes.clone())
            .unwrap()
            .fit(&target, &bounds, regularisation)
            .unwrap();
        let reference = oracle(&shapes, &target, &bounds, regularisation);
        for (found, wanted) in fit.weights.iter().zip(&reference) {
            assert!(
                (found - wanted).abs() < 1e-6,
                "round {round}: {found} against {wanted}"
            );
        }
        let ours = objective(&shapes, &target, &fit.weights, regularisation);
        assert!(ours <= objective(&shapes, &target, &reference, regularisation) * (1.0 + 1e-9));
        bound_total += fit
            .activity
            .iter()
            .filter(|&&activity| activity != Activity::Free)
            .count();
    }
    assert!(
        bound_total > 100,
        "the cases must exercise the bounds, only {bound_total} were met"
    );
}

#[test]
fn residuals_are_those_of_the_shapes() {
    let shapes = vec![vec![Vector3::x(), Vector3::zeros()]];
    let target = vec![Vector3::x() * 0.25, Vector3::y() * 3.0];
    let fit = BlendBasis::new(shapes)
        .unwrap()
        .fit(&target, &Bounds::uniform(1, 0.0, 1.0), 0.0)
        .unwrap();
    assert!((fit.weights[0] - 0.25).abs() < 1e-11);
    assert!((fit.residual_max - 3.0).abs() < 1e-14);
    assert!((fit.residual_rms - 4.5_f64.sqrt()).abs() < 1e-14);
}

#[test]
fn repeated_shapes_share_their_weight() {
    let shape = Noise(3).shape(10);
    let target: Shape = shape.iter().map(|v| v * 0.8).collect();
    let basis = BlendBasis::new(vec![shape.clone(), shape]).unwrap();
    let fit = basis
        .fit(&target, &Bounds::uniform(2, 0.0, 1.0), 0.0)
        .unwrap();
    assert!((fit.weights[0] + fit.weights[1] - 0.8).abs() < 1e-11);
    assert!((fit.weights[0] - 0.4).abs() < 1e-3, "{:?}", fit.weights);
}

#[test]
fn a_basis_larger_than_the_mesh_still_fits() {
    let mut noise = Noise(11);
    let shapes = noise.shapes(300, 4);
    let target = noise.shape(4);
    let bounds = Bounds::uniform(300, 0.0, 1.0);
    let fit = BlendBasis::new(shapes.clone())
        .unwrap()
        .fit(&target, &bounds, 0.0)
        .unwrap();
    assert_optimal(&shapes, &target, &bounds, 0.0, &fit);
    assert!(fit.residual_rms < 1e-9);
}

#[test]
fn zero_shapes_get_the_weight_nearest_zero() {
    let basis = BlendBasis::new(vec![vec![Vector3::zeros(); 3]; 2]).unwrap();
    let bounds = Bounds {
        lower: vec![0.2, -1.0],
        upper: vec![1.0, 1.0],
    };
    let fit = basis.fit(&[Vector3::x(); 3], &bounds, 0.0).unwrap();
    assert_eq!(fit.weights, [0.2, 0.0]);
    assert!((fit.residual_rms - 1.0).abs() < 1e-15);
}

#[test]
fn vertex_weights_count_like_repeated_vertices() {
    let mut noise = Noise(5);
    let shapes = noise.shapes(4, 6);
    let target = noise.shape(6);
    let counts = [3.0, 1.0, 0.0, 2.0, 1.0, 1.0];
    let repeat = |shape: &Shape| -> Shape {
        shape
            .iter()
            .zip(counts)
            .flat_map(|(v, count)| vec![*v; count as usize])
            .collect()
    };
    let bounds = Bounds::uniform(4, 0.0, 1.0);
    let weighted = BlendBasis::weighted(shapes.clone(), &counts)
        .unwrap()
        .fit(&target, &bounds, 0.0)
        .unwrap();
    let repeated = BlendBasis::new(shapes.iter().map(repeat).collect()).unwrap();
    let repeated = repeated.fit(&repeat(&target), &bounds, 0.0).unwrap();
    for (a, b) in weighted.weights.iter().zip(&repeated.weights) {
        assert!((a - b).abs() < 1e-10);
    }
    assert!((weighted.residual_rms - repeated.residual_rms).abs() < 1e-12);
    assert!((weighted.residual_max - repeated.residual_max).abs() < 1e-12);
}

#[test]
fn bad_input_is_named() {
    let shape = vec![Vector3::x(); 3];
    let basis = BlendBasis::new(vec![shape.clone(); 2]).unwrap();
    let unit = Bounds::uniform(2, 0.0, 1.0);
    assert_eq!(BlendBasis::new(vec![]).unwrap_err(), RigError::EmptyBasis);
    assert_eq!(
        BlendBasis::new(vec![vec![]]).unwrap_err(),
        RigError::NoVertices
    );
    assert_eq!(
        BlendBasis::new(vec![shape.clone(), vec![Vector3::x()]]).unwrap_err(),
        RigError::ShapeVertexCount {
            shape: 1,
            found: 1,
            expected: 3
        }
    );
    assert!(matches!(
        BlendBasis::new(vec![vec![Vector3::new(f64::NAN, 0.0, 0.0)]]).unwrap_err(),
        RigError::NonFiniteShape {
            shape: 0,
            vertex: 0,
            ..
        }
    ));
    for scale in [1e-200, 1e200] {
        let scaled = vec![shape.iter().map(|v| v * scale).collect()];
        assert_eq!(
            BlendBasis::new(scaled).unwrap_err(),
            RigError::ShapeScale { shape: 0 }
        );
    }
    assert_eq!(
        basis
            .fit(&[Vector3::x() * 1e200; 3], &unit, 0.0)
            .unwrap_err(),
        RigError::TargetScale
    );
    assert_eq!(
        basis.fit(&shape[..1], &unit, 0.0).unwrap_err(),
        RigError::TargetVertexCount {
            found: 1,
            expected: 3
        }
    );
    assert_eq!(
        basis
            .fit(&shape, &Bounds::uniform(1, 0.0, 1.0), 0.0)
            .unwrap_err(),
        RigError::BoundCount {
            lower: 1,
            upper: 1,
            shapes: 2
        }
    );
    for (lower, upper) in [
        (1.0, 0.0),
        (f64::INFINITY, f64::INFINITY),
        (f64::NEG_INFINITY, f64::NEG_INFINITY),
    ] {
        let error = basis
            .fit(&shape, &Bounds::uniform(2, lower, upper), 0.0)
            .unwrap_err();
        assert_eq!(
            error,
            RigError::CrossedBounds {
                shape: 0,
                lower,
                upper
            }
        );
    }
    assert!(
        basis
            .fit(&shape, &Bounds::uniform(2, f64::NAN, 1.0), 0.0)
            .is_err()
    );
    assert_eq!(
        basis.fit(&shape, &unit, -1.0).unwrap_err(),
        RigError::Regularisation { value: -1.0 }
    );
    assert!(matches!(
        BlendBasis::weighted(vec![shape.clone()], &[1.0, -1.0, 0.0]).unwrap_err(),
        RigError::VertexWeight { vertex: 1, .. }
    ));
    assert_eq!(
        BlendBasis::weighted(vec![shape], &[0.0; 3]).unwrap_err(),
        RigError::NoVertexWeight
    );
}
