//! `body`: a surface of the user's, beside a box of as many elements.

use crate::case::Case;
use crate::error::Result;
use crate::files::{check_writable, write_json};
use crate::measure::{Measurement, measure};
use crate::options::{SolveArgs, SurfaceArgs, use_threads};
use crate::table::{print, print_measurement, row, say};
use clap::Args;
use serde::Serialize;

/// Options of `body`.
#[derive(Args, Debug)]
#[command(mut_arg("surface", |arg| arg.required(true)))]
pub struct BodyArgs {
    #[command(flatten)]
    body: SurfaceArgs,
    /// Solve tightly as well, and tell the largest distance of a node from there.
    #[arg(long)]
    reference: bool,
    #[command(flatten)]
    solve: SolveArgs,
}

/// Body, box, and how they compare.
#[derive(Serialize)]
struct Report {
    #[serde(flatten)]
    body: Measurement,
    /// Microseconds per element of the body.
    per_element_us: Steps,
    /// Seconds per element of the body over those of the box.
    ratio_to_box: Steps,
    /// The box of as many elements (to the nearest of its proportions).
    solid_box: Measurement,
}

#[derive(Serialize, Clone, Copy)]
struct Steps {
    setup: f64,
    forward: f64,
    backward: f64,
}

impl Steps {
    fn per_element(m: &Measurement) -> Self {
        let per_element = 1.0 / m.elements as f64;
        Self {
            setup: m.setup_s * per_element,
            forward: m.forward_s * per_element,
            backward: m.backward_s * per_element,
        }
    }

    fn map2(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            setup: f(self.setup, other.setup),
            forward: f(self.forward, other.forward),
            backward: f(self.backward, other.backward),
        }
    }
}

/// Measures, prints and writes; whether everything converged.
///
/// # Errors
/// When the surface cannot be used, no node is held, or the file cannot be written.
pub fn run(args: &BodyArgs) -> Result<bool> {
    let json = args.solve.repeat.json.as_deref();
    check_writable(json)?;
    use_threads(args.solve.repeat.threads)?;
    let case = args
        .body
        .case(args.solve.seed)?
        .expect("clap asks for a surface");
    let body = measure(&case, &args.solve, args.reference)?;
    drop(case);
    print_measurement(&body);
    let solid_box = measure(&Case::box_with(body.elements)?, &args.solve, false)?;
    let (own, other) = (Steps::per_element(&body), Steps::per_element(&solid_box));
    let report = Report {
        per_element_us: own.map2(own, |s, _| 1e6 * s),
        ratio_to_box: own.map2(other, |s, b| s / b),
        body,
        solid_box,
    };
    write_json(json, &report)?;
    print_comparison(&report);
    Ok(report.body.converged() && report.solid_box.converged())
}

fn print_comparison(report: &Report) {
    let [x, y, z] = report.solid_box.cells.unwrap_or_default();
    say(&format!(
        "\nper element, beside the box of {x} x {y} x {z}:\n"
    ));
    let (us, ratio) = (&report.per_element_us, &report.ratio_to_box);
    let line =
        |step: &str, us: f64, ratio: f64| row([step, &format!("{us:.3}"), &format!("{ratio:.2}")]);
    print(&[
        row(["step", "us", "ratio"]),
        line("setup", us.setup, ratio.setup),
        line("forward", us.forward, ratio.forward),
        line("backward", us.backward, ratio.backward),
    ]);
}
