//! Writes a file of squares, whole or not at all: `cargo run -p whole-file --example numbers squares.txt`.

use std::path::PathBuf;

fn main() -> std::io::Result<()> {
    let name = std::env::args().nth(1);
    let path = match name {
        Some(name) => PathBuf::from(name),
        None => std::env::temp_dir().join("squares.txt"),
    };
    whole_file::write(&path, |file| {
        (1..=10).try_for_each(|n: u32| writeln!(file, "{n} {}", n * n))
    })?;
    println!("{}", path.display());
    Ok(())
}
