//! Options that several commands share, and how their values are read.

use crate::case::{Case, HalfSpace};
use crate::error::{BenchError, Result};
use clap::Args;
use pd_solver::{AdjointOptions, Method, SolveOptions, Stop};
use serde::Deserialize;
use serde::de::{Deserializer, Visitor};
use std::path::PathBuf;

/// How to solve, and how often.
#[derive(Args, Debug, Clone)]
pub struct SolveArgs {
    /// Method of the forward solve; the solver's default unless given.
    #[arg(long, value_name = "M", default_value_t = Name::default(), value_parser = parse_method, help = method_help())]
    pub method: Name,
    /// Stop when |g| <= T |g at rest| over the free nodes.
    #[arg(long, value_name = "T", default_value_t = 1e-4, allow_hyphen_values = true, value_parser = parse_positive)]
    pub relative_gradient: f64,
    /// Relative residual of the adjoint's linear solve.
    #[arg(long, value_name = "T", default_value_t = 1e-6, allow_hyphen_values = true, value_parser = parse_positive)]
    pub adjoint_tolerance: f64,
    /// Limit of iterations of the forward solve.
    #[arg(long, value_name = "N", default_value_t = 2000, allow_hyphen_values = true, value_parser = parse_count)]
    pub max_iterations: usize,
    /// Seed of the random cotangent, and of the actuation of a body inside a surface.
    #[arg(long, value_name = "N", default_value_t = 1, allow_hyphen_values = true, value_parser = parse_seed)]
    pub seed: u64,
    #[command(flatten)]
    pub repeat: RepeatArgs,
}

/// How often to measure, on how many threads, and where to write.
#[derive(Args, Debug, Clone)]
pub struct RepeatArgs {
    /// Repetitions; medians are told.
    #[arg(long, value_name = "N", default_value_t = 5, allow_hyphen_values = true, value_parser = parse_count)]
    pub runs: usize,
    /// Repeat each step no more once it has taken so many seconds in all; every step is done once at least.
    #[arg(long, value_name = "SECONDS", default_value_t = 600.0, allow_hyphen_values = true, value_parser = parse_positive)]
    pub budget: f64,
    /// Threads; RAYON_NUM_THREADS or all cores unless given.
    #[arg(long, value_name = "T", allow_hyphen_values = true, value_parser = parse_threads)]
    pub threads: Option<usize>,
    /// Write everything to this file.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// A body inside a surface of the user's.
#[derive(Args, Debug, Clone)]
pub struct SurfaceArgs {
    /// Closed surface: OBJ, glTF or GLB.
    #[arg(long, value_name = "FILE", requires = "element_size")]
    surface: Option<PathBuf>,
    /// Edge of an element, in the surface's unit.
    #[arg(long, value_name = "H", requires = "surface", allow_hyphen_values = true, value_parser = parse_positive)]
    element_size: Option<f64>,
    /// Nodes held at rest, such as "z<0.1"; the lowest tenth of the longest axis unless given.
    #[arg(long, value_name = "AXIS<VALUE", requires = "surface", allow_hyphen_values = true, value_parser = HalfSpace::parse)]
    fix: Option<HalfSpace>,
    /// Bound on the entries of the random actuation.
    #[arg(long, value_name = "X", default_value_t = 0.2, requires = "surface", allow_hyphen_values = true, value_parser = parse_finite)]
    amplitude: f64,
}

impl SurfaceArgs {
    /// The body, where there is a surface; its actuation is random by the seed.
    ///
    /// # Errors
    /// As [`Case::body`].
    pub fn case(&self, seed: u64) -> Result<Option<Case>> {
        let given = self.surface.as_ref().zip(self.element_size);
        let fix = self.fix.as_ref();
        given
            .map(|(surface, size)| Case::body(surface, size, fix, self.amplitude, seed))
            .transpose()
    }
}

impl SolveArgs {
    /// Options of the forward solve.
    pub fn forward(&self) -> SolveOptions {
        SolveOptions {
            max_iterations: self.max_iterations,
            ..SolveOptions::new(Stop::RelativeGradient(self.relative_gradient))
                .with_method(self.method.0)
        }
    }

    /// Options of the adjoint.
    pub fn adjoint(&self) -> AdjointOptions {
        AdjointOptions {
            tolerance: self.adjoint_tolerance,
            ..AdjointOptions::default()
        }
    }
}

/// Sets the size of the thread pool for the rest of the process.
///
/// # Errors
/// When the system does not give so many threads.
pub fn use_threads(threads: Option<usize>) -> Result<()> {
    let Some(threads) = threads else {
        return Ok(());
    };
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .map_err(|cause| BenchError::Option {
            option: "--threads",
            value: threads.to_string(),
            reason: cause.to_string(),
        })
}

/// A method under the name that files give it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Name(pub Method);

impl std::fmt::Display for Name {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let value = serde_json::to_value(self.0).map_err(|_| std::fmt::Error)?;
        f.write_str(value.as_str().ok_or(std::fmt::Error)?)
    }
}

/// The names of all methods that the solver has: whatever its `Deserialize` accepts, so that a new one needs no word here.
pub fn method_names() -> Vec<&'static str> {
    struct Names<'a>(&'a mut &'static [&'static str]);
    impl<'de> Deserializer<'de> for Names<'_> {
        type Error = serde::de::value::Error;

        fn deserialize_any<V: Visitor<'de>>(
            self,
            _: V,
        ) -> std::result::Result<V::Value, Self::Error> {
            Err(serde::de::Error::custom("only the names are asked for"))
        }

        fn deserialize_enum<V: Visitor<'de>>(
            self,
            _: &'static str,
            variants: &'static [&'static str],
            visitor: V,
        ) -> std::result::Result<V::Value, Self::Error> {
            *self.0 = variants;
            self.deserialize_any(visitor)
        }

        serde::forward_to_deserialize_any! {
            bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64 char str string bytes byte_buf option unit unit_struct newtype_struct seq
            tuple tuple_struct map struct identifier ignored_any
        }
    }
    let mut names: &'static [&'static str] = &[];
    // An error by design: the names are known by then.
    Method::deserialize(Names(&mut names)).ok();
    names.to_vec()
}

fn method_help() -> String {
    format!("Method of the forward solve: {}", listed(&method_names()))
}

/// `a, b or c`.
fn listed(names: &[&str]) -> String {
    match names {
        [] => String::new(),
        [one] => (*one).to_string(),
        [most @ .., last] => format!("{} or {last}", most.join(", ")),
    }
}

/// A method by its name.
pub fn parse_method(text: &str) -> std::result::Result<Name, String> {
    let method = serde_json::from_value(text.into()).map(Name);
    method.map_err(|_| format!("use {}", listed(&method_names())))
}

/// `NX,NY,NZ`.
pub fn parse_cells(text: &str) -> std::result::Result<[usize; 3], String> {
    three(text, ',').ok_or_else(|| "write three whole numbers above zero, such as 32,16,16".into())
}

fn three(text: &str, separator: char) -> Option<[usize; 3]> {
    let counts: Option<Vec<usize>> = text
        .split(separator)
        .map(|n| n.trim().parse().ok())
        .collect();
    let counts = <[usize; 3]>::try_from(counts?).ok()?;
    counts.iter().all(|&n| n > 0).then_some(counts)
}

/// A size of the reference box.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Size {
    /// As the user wrote it.
    pub name: String,
    /// Elements along x, y, z.
    pub cells: [usize; 3],
}

/// Sizes that have a name: the ones that published times are for.
const NAMED_SIZES: [(&str, [usize; 3]); 4] = [
    ("8k", [32, 16, 16]),
    ("30k", [48, 25, 25]),
    ("128k", [80, 40, 40]),
    ("250k", [100, 50, 50]),
];

/// A named size, or `NXxNYxNZ`.
pub fn parse_size(text: &str) -> std::result::Result<Size, String> {
    let text = text.trim();
    let named = NAMED_SIZES.iter().find(|(name, _)| *name == text);
    let cells = named.map(|(_, cells)| *cells).or_else(|| three(text, 'x'));
    let name = text.to_string();
    cells
        .map(|cells| Size { name, cells })
        .ok_or_else(|| "use 8k, 30k, 128k, 250k, or cells such as 64x32x32".into())
}

/// A finite number above zero.
pub fn parse_positive(text: &str) -> std::result::Result<f64, String> {
    let number = text
        .parse()
        .ok()
        .filter(|x: &f64| x.is_finite() && *x > 0.0);
    number.ok_or_else(|| "give a finite number above zero".into())
}

/// A finite number.
pub fn parse_finite(text: &str) -> std::result::Result<f64, String> {
    let number = text.parse().ok().filter(|x: &f64| x.is_finite());
    number.ok_or_else(|| "give a finite number".into())
}

/// A whole number above zero.
pub fn parse_count(text: &str) -> std::result::Result<usize, String> {
    let number = text.parse().ok().filter(|&n| n > 0);
    number.ok_or_else(|| "give a whole number above zero".into())
}

/// A seed.
pub fn parse_seed(text: &str) -> std::result::Result<u64, String> {
    let number = text.parse().ok();
    number.ok_or_else(|| format!("give a whole number from 0 to {}", u64::MAX))
}

/// More threads than any machine that this runs on has cores would only exhaust the system.
const MOST_THREADS: usize = 1024;

/// A number of threads.
pub fn parse_threads(text: &str) -> std::result::Result<usize, String> {
    let number = text.parse().ok().filter(|n| (1..=MOST_THREADS).contains(n));
    number.ok_or_else(|| format!("give a whole number from 1 to {MOST_THREADS}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_method_is_named_and_read_back() {
        let names = method_names();
        assert!(names.contains(&Name::default().to_string().as_str()));
        for name in names {
            assert_eq!(parse_method(name).unwrap().to_string(), name);
        }
    }

    #[test]
    fn sizes_are_named_or_written_out() {
        assert_eq!(parse_size("8k").unwrap().cells, [32, 16, 16]);
        assert_eq!(parse_size(" 4x2x3 ").unwrap().cells, [4, 2, 3]);
        for wrong in ["", "9k", "4x2", "4x2x0", "4x2x3x1", "-4x2x2"] {
            assert!(parse_size(wrong).is_err(), "{wrong}");
        }
    }
}
