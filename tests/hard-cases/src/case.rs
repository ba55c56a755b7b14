//! What a case is, and what is found when it runs.

use pd_solver::Method;

/// Chapters of the catalogue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Section {
    /// One 3x3 matrix at a time.
    Samples,
    /// Where a solve begins.
    Starts,
    /// What the material wants.
    Actuations,
    /// What it is made of.
    Bodies,
    /// What acts on it beside its own elasticity.
    Effects,
    /// Gradients.
    Adjoints,
    /// Many calls.
    LongRuns,
}

impl Section {
    /// All of them, in order.
    pub const ALL: [Section; 7] = [
        Section::Samples,
        Section::Starts,
        Section::Actuations,
        Section::Bodies,
        Section::Effects,
        Section::Adjoints,
        Section::LongRuns,
    ];

    /// Its heading.
    pub fn title(self) -> &'static str {
        match self {
            Section::Samples => "Single samples",
            Section::Starts => "Starts",
            Section::Actuations => "Actuations",
            Section::Bodies => "Bodies",
            Section::Effects => "Effects",
            Section::Adjoints => "Adjoints",
            Section::LongRuns => "Long runs",
        }
    }
}

/// How much is done: the catalogue as it is published, or as little as still means something.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Random draws per class of samples.
    pub draws: usize,
    /// Solves of a long run.
    pub calls: usize,
}

impl Effort {
    /// What the published table is made with.
    pub const FULL: Effort = Effort {
        draws: 1_000_000,
        calls: 10_000,
    };
    /// What the tests do.
    pub const QUICK: Effort = Effort {
        draws: 5_000,
        calls: 200,
    };
}

/// A case as its chapter lists it: name, story, and what is done.
pub(crate) type Entry = (&'static str, &'static str, fn(&Effort) -> Finding);

/// A hard case.
pub struct Case {
    /// Chapter.
    pub section: Section,
    /// Name, unique in the catalogue.
    pub name: String,
    /// What is hard about it, in one line.
    pub story: &'static str,
    run: Box<dyn Fn(&Effort) -> Finding>,
}

impl Case {
    /// A case from its generator.
    pub fn new(
        section: Section,
        name: impl Into<String>,
        story: &'static str,
        run: impl Fn(&Effort) -> Finding + 'static,
    ) -> Self {
        Self {
            section,
            name: name.into(),
            story,
            run: Box::new(run),
        }
    }

    /// Runs it.
    pub fn run(&self, effort: &Effort) -> Finding {
        (self.run)(effort)
    }
}

/// What was found.
#[derive(Debug, Clone, Default)]
pub struct Finding {
    /// How it ended, in a word or two.
    pub status: String,
    /// Iterations of the solves in it.
    pub iterations: usize,
    /// Worst residual: of a solve, its gradient relative to that at the start or at rest; of a sample, the worst error of an identity.
    pub residual: f64,
    /// Smallest s_i + s_j met, where a linearisation told.
    pub smallest_pair_sum: Option<f64>,
    /// Whether negative curvature was met.
    pub negative_curvature: bool,
    /// Per method, how many of how many starts found the known answer again.
    pub recovered: Vec<(Method, usize, usize)>,
    /// What is worth knowing beside.
    pub notes: Vec<String>,
    /// What must hold and does not; nothing when all is well.
    pub broken: Vec<String>,
}

impl Finding {
    /// Notes what must hold and does not; `what` is only asked then.
    pub fn require(&mut self, holds: bool, what: impl FnOnce() -> String) {
        if !holds {
            self.broken.push(what());
        }
    }

    /// Takes in another finding, as one part of this one.
    pub fn merge(&mut self, other: Finding) {
        if !other.status.is_empty() && !self.status.split(", ").any(|s| s == other.status) {
            if !self.status.is_empty() {
                self.status.push_str(", ");
            }
            self.status.push_str(&other.status);
        }
        self.iterations += other.iterations;
        // A residual that is not a number must not hide behind one that is.
        if other.residual.is_nan() || other.residual > self.residual {
            self.residual = other.residual;
        }
        self.see_pair_sum(other.smallest_pair_sum);
        self.negative_curvature |= other.negative_curvature;
        self.recovered.extend(other.recovered);
        self.notes.extend(other.notes);
        self.broken.extend(other.broken);
    }

    /// Keeps the smallest of the sums seen.
    pub fn see_pair_sum(&mut self, sum: Option<f64>) {
        self.smallest_pair_sum = match (self.smallest_pair_sum, sum) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        };
    }
}
