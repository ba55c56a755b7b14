//! What a fit leaves behind: numbers, meshes, pictures, and the table.

use super::{Fit, Fitted, Target};
use crate::body::Body;
use crate::error::Result;
use crate::files::write_json;
use crate::scene::Scene;
use crate::shapes::difference;
use crate::sheets::{Compared, write_pages};
use crate::table::mean_of;
use nalgebra::Vector3;
use serde::Serialize;
use surface_mesh::{MorphTarget, MorphedSurface, printable, write_glb};

/// What `fit.json` holds.
#[derive(Serialize)]
struct Numbers<'a> {
    scene: &'a str,
    bbox_diagonal: f64,
    unit: &'a str,
    element_size: f64,
    elements: usize,
    /// Limit of the steps.
    fit_steps: usize,
    shapes: &'a [Fitted],
}

/// Writes everything a fit shows, the numbers last.
///
/// # Errors
/// When a file cannot be written.
pub(super) fn write(scene: &Scene, body: &Body, fit: &Fit, steps: usize) -> Result<()> {
    let rest = body.surface.vertices();
    let targets = fit.shapes.iter().map(|fitted| MorphTarget {
        name: fitted.name.clone(),
        deltas: difference(&fitted.surface, rest),
    });
    let fitted = MorphedSurface::new(body.surface.clone(), targets.collect())?;
    write_glb(fit.folder.join("fit.glb"), &fitted)?;
    let rows = fit.shapes.iter().flat_map(|fitted| rows(body, fitted));
    let title = format!("{}: before and after the fit", scene.name);
    let rows: Vec<Compared> = rows.collect();
    write_pages(&fit.folder, "fit-sheet", title, scene, body, &rows)?;
    let numbers = Numbers {
        scene: &scene.name,
        bbox_diagonal: body.diagonal,
        unit: &scene.unit,
        element_size: body.mesh.element_size(),
        elements: body.mesh.elements().len(),
        fit_steps: steps,
        shapes: &fit.shapes,
    };
    write_json(&fit.folder.join("fit.json"), &numbers)
}

/// Two rows of a sheet, before and after. Vertices that do not count at the end are drawn without error.
fn rows<'a>(body: &Body, fitted: &'a Fitted) -> [Compared<'a>; 2] {
    let (target, target_triangles) = fitted.target.mesh();
    let left_out = fitted.left_out.map_or(String::new(), |left_out| {
        format!(", {:.0} % left out", 100.0 * left_out.total())
    });
    let row = |when: &str, surface: &'a [Vector3<f64>], mean: f64| {
        let distances = fitted.target.measure(body, surface).distances;
        let counted = distances.iter().zip(&fitted.weights);
        let percent = 100.0 * mean / body.diagonal;
        Compared {
            name: format!("{}, {when}", fitted.name),
            target,
            target_triangles,
            simulated: surface,
            errors: counted
                .map(|(d, w)| if *w > 0.0 { *d } else { 0.0 })
                .collect(),
            note: format!("weighted mean {percent:.2} %{left_out}"),
        }
    };
    [
        row("before", &fitted.surface_before, fitted.before.mean),
        row("after", &fitted.surface, fitted.after.mean),
    ]
}

/// The table that a fit ends with.
pub fn fit_table(fit: &Fit) -> String {
    use std::fmt::Write;
    let names = fit
        .shapes
        .iter()
        .map(|f| printable(&f.name).chars().count());
    let width = names.max().unwrap_or(0).max(5);
    let mut out = String::new();
    let pair = |what: &str| format!("{:>21}", format!("{what} {}", fit.unit));
    let _ = writeln!(
        out,
        "{:width$}  {}  {}  {}  steps  simulations  seconds  inverted",
        "shape",
        pair("mean"),
        pair("p99"),
        pair("max")
    );
    for f in &fit.shapes {
        let pair = |a: f64, b: f64| format!("{a:8.5} -> {b:9.5}");
        let mut notes = String::new();
        if matches!(f.target, Target::Scan(_)) {
            let _ = write!(notes, "  from {}", printable(&f.start));
        }
        if let Some(left_out) = &f.left_out {
            let [total, far, border, facing] = [
                left_out.total(),
                left_out.far,
                left_out.border,
                left_out.facing,
            ]
            .map(|share| 100.0 * share);
            let _ = write!(
                notes,
                "  {total:.1} % left out ({far:.1} beyond the reach, {border:.1} past the border, {facing:.1} facing another way)"
            );
        }
        let _ = writeln!(
            out,
            "{:width$}  {}  {}  {}  {:5}  {:11}  {:7.2}  {:8}{notes}",
            printable(&f.name),
            pair(f.before.mean, f.after.mean),
            pair(f.before.p99, f.after.p99),
            pair(f.before.max, f.after.max),
            f.steps,
            f.simulations,
            f.seconds,
            f.inverted_elements,
        );
    }
    let before = mean_of(fit.shapes.iter().map(|f| f.before.mean));
    let after = mean_of(fit.shapes.iter().map(|f| f.after.mean));
    let _ = writeln!(
        out,
        "{:width$}  weighted mean error {before:.5} {unit} before, {after:.5} {unit} after ({:.1} times less)",
        "",
        before / after.max(f64::MIN_POSITIVE),
        unit = fit.unit
    );
    out
}
