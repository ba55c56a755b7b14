//! `box`: the reference case.

use crate::case::Case;
use crate::error::Result;
use crate::files::{check_writable, write_json};
use crate::measure::measure;
use crate::options::{SolveArgs, parse_cells, parse_finite, use_threads};
use crate::table::print_measurement;
use clap::Args;

/// Options of `box`.
#[derive(Args, Debug)]
pub struct BoxArgs {
    /// Elements along x, y and z.
    #[arg(long, value_name = "NX,NY,NZ", allow_hyphen_values = true, value_parser = parse_cells)]
    cells: [usize; 3],
    /// Factor on the actuation.
    #[arg(long, value_name = "X", default_value_t = 1.0, allow_hyphen_values = true, value_parser = parse_finite)]
    amplitude: f64,
    /// Solve tightly as well, and tell the largest distance of a node from there.
    #[arg(long)]
    reference: bool,
    #[command(flatten)]
    solve: SolveArgs,
}

/// Measures, prints and writes; whether everything converged.
///
/// # Errors
/// When the box is too large, or the file cannot be written.
pub fn run(args: &BoxArgs) -> Result<bool> {
    let json = args.solve.repeat.json.as_deref();
    check_writable(json)?;
    use_threads(args.solve.repeat.threads)?;
    let case = Case::solid_box(args.cells, args.amplitude)?;
    let measurement = measure(&case, &args.solve, args.reference)?;
    write_json(json, &measurement)?;
    print_measurement(&measurement);
    Ok(measurement.converged())
}
