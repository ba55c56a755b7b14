use super::*;
use crate::fixture;

fn tried(sizes: &[f64], error: impl Fn(f64) -> f64) -> Vec<Tried> {
    let moved = |k: usize| (k > 0).then(|| error(sizes[k - 1]) - error(sizes[k]));
    let of = |k: usize| Tried {
        element_size: sizes[k],
        elements: (1.0 / sizes[k].powi(3)) as usize,
        moved: moved(k),
    };
    (0..sizes.len()).map(of).collect()
}

#[test]
fn an_error_that_is_a_power_of_the_size_is_told_exactly() {
    let sizes = [0.2, 0.2 / RATIO, 0.1];
    for order in [1.0, 1.5, 2.0] {
        let error = |h: f64| 0.3 * h.powf(order);
        let fitted = extrapolate(&tried(&sizes, error), error(0.06), ORDERS);
        assert!((fitted.order - order).abs() < 1e-9);
        assert!(
            (fitted.element_size - 0.06).abs() <= 1e-3 * 0.06,
            "{fitted:?}"
        );
        // Nothing coarser than what was tried.
        let coarse = extrapolate(&tried(&sizes, error), error(1.0), ORDERS);
        assert!(coarse.element_size <= 0.2 && coarse.element_size > 0.199);
    }
}

#[test]
fn grids_of_noise_are_not_believed_to_converge_fast_or_not_at_all() {
    let sizes = [0.2, 0.2 / RATIO, 0.1];
    let jump = |h: f64| if h > 0.15 { 1.0 } else { 1e-6 * h };
    let still = |h: f64| 1e-3 * h.ln();
    assert_eq!(
        extrapolate(&tried(&sizes, jump), 1e-3, ORDERS).order,
        ORDERS[1]
    );
    assert_eq!(
        extrapolate(&tried(&sizes, still), 1e-3, ORDERS).order,
        ORDERS[0]
    );
}

#[test]
fn sizes_have_three_digits_and_never_round_up() {
    for (x, expected) in [(0.123_99, 0.123), (98.76, 98.7), (1e-5, 1e-5), (0.3, 0.3)] {
        let short = three_digits(x);
        assert!(
            (short / expected - 1.0).abs() < 0.011 && short <= x,
            "{x} {short}"
        );
        assert!(
            format!("{short}").trim_start_matches(['0', '.']).len() <= 4,
            "{short}"
        );
    }
}

#[test]
fn the_grid_that_is_chosen_keeps_the_accuracy() {
    let scene = fixture::scene("");
    let (inputs, rig) = (fixture::inputs(), Rig::default());
    let [loose, tight] = [0.06, 0.03].map(|asked| {
        let fitted = fit_element_size(&scene, &inputs, &rig, asked).unwrap();
        (asked, fitted.element_size)
    });
    assert!(tight.1 < loose.1, "{loose:?} {tight:?}");
    // The actuation that fits, on a much finer grid.
    let surface = |size: f64| {
        let body = Body::of_scene(&scene, inputs.surface.clone(), &rig, size).unwrap();
        (deformed(&body, &scene, 0.3, 1e-3).unwrap(), body)
    };
    let (exact, body) = surface(0.06);
    for (asked, size) in [loose, tight] {
        let error = mean_distance(&surface(size).0, &exact, &body.vertex_weights);
        println!("asked {asked}, elements of {size}: {error}");
        assert!(error < asked, "{error} {asked}");
    }
}

#[test]
fn an_accuracy_that_no_grid_gives_is_refused_with_what_it_would_take() {
    let scene = fixture::scene("");
    let error = fit_element_size(&scene, &fixture::inputs(), &Rig::default(), 1e-7).unwrap_err();
    assert!(matches!(error, TrainerError::GridTooFine { .. }), "{error}");
    let (mut scene, text) = (fixture::scene(""), fixture::SCENE.to_string());
    scene.accuracy = None;
    let path = Path::new("ball.toml");
    let missing = fitted(path, (scene, text), &fixture::inputs(), &Rig::default()).unwrap_err();
    assert!(missing.to_string().contains("--accuracy"), "{missing}");
}
