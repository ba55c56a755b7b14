//! The case with a known answer on finer and finer grids: `cargo run --release -p accuracy --example known_answer`.

use accuracy::manufactured::convergence;
use accuracy::table::convergence_table;

fn main() -> accuracy::Result<()> {
    print!("{}", convergence_table(&convergence()?));
    Ok(())
}
