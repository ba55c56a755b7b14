//! The study: a matrix of choices against a reference that is finer and tighter than all of them, and each kind of error by itself.

use crate::choice::{Choice, Simulated, Split};
use crate::error::{AccuracyError, Result};
use crate::subject::Subject;
use pd_solver::Method;
use serde::{Deserialize, Serialize};
use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};
use trainer::scene::ActuationPer;
use trainer::stop_requested;

/// What is varied.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Plan {
    /// Element sizes, in those of the scene, the largest first.
    pub sizes: Vec<f64>,
    /// Element size of the reference, in those of the scene.
    pub reference_size: f64,
    /// Accuracies of the solver, in diagonals, the loosest first.
    pub accuracies: Vec<f64>,
    /// Accuracy of all that others are measured by, in diagonals.
    pub tight: f64,
    /// Methods of the solver.
    pub methods: Vec<Method>,
    /// Shapes that are simulated.
    pub shapes: usize,
}

impl Plan {
    /// A few minutes on two cores for a body of some thousand elements.
    pub fn quick() -> Self {
        Self {
            sizes: vec![2.0, 1.6, 1.3, 1.0, 0.8],
            reference_size: 0.5,
            accuracies: vec![1e-2, 1e-3, 1e-4, 1e-5],
            tight: 1e-7,
            methods: vec![
                Method::Automatic,
                Method::Lbfgs,
                Method::Newton,
                Method::Anderson,
                Method::LocalGlobal,
            ],
            shapes: 2,
        }
    }

    /// Finer, with more shapes: hours for a large body.
    pub fn full() -> Self {
        Self {
            sizes: vec![2.0, 1.6, 1.3, 1.0, 0.8, 0.65],
            reference_size: 0.4,
            shapes: 4,
            ..Self::quick()
        }
    }
}

/// Which question a row answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Question {
    /// The whole matrix, against the reference.
    Matrix,
    /// Element size, with everything else as fine as in the reference.
    Discretisation,
    /// Samples of an element, against 27 on the same grid.
    Quadrature,
    /// One actuation per element, against one per sample.
    Points,
    /// Accuracy asked of the solver, against a tight solve on the same grid.
    Solver,
    /// Method of the solver, against a tight solve on the same grid.
    Method,
    /// Width of the network, against the target shapes.
    Network,
}

/// One choice, measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What is asked.
    pub question: Question,
    /// The choice.
    pub choice: Choice,
    /// Elements of the body.
    pub elements: usize,
    /// Mean distance of the surface from what it is measured by, of the shape that is farthest, in diagonals.
    pub error: f64,
    /// Largest error that the solver told, in diagonals.
    pub estimated: f64,
    /// Seconds for voxels and solver, once.
    pub setup: f64,
    /// Seconds per shape.
    pub split: Split,
    /// Steps of the solver per shape.
    pub iterations: f64,
    /// Shapes that did not reach the accuracy.
    pub failed: usize,
}

/// Rows that are kept as they come, so that a study goes on where it ended.
pub struct Study<'a> {
    subject: &'a Subject,
    plan: Plan,
    path: PathBuf,
    rows: Vec<Row>,
}

/// The first line of the file of rows.
#[derive(PartialEq, Serialize, Deserialize)]
struct Header {
    plan: Plan,
    scene: trainer::scene::Scene,
}

impl<'a> Study<'a> {
    /// Opens the study in a folder, or begins one.
    ///
    /// # Errors
    /// When the folder holds the rows of another study, or cannot be read or written.
    pub fn open(subject: &'a Subject, plan: Plan, folder: &Path) -> Result<Self> {
        let path = folder.join("rows.jsonl");
        let header = Header {
            plan: plan.clone(),
            scene: subject.scene.clone(),
        };
        let broken = |problem: String| AccuracyError::Folder {
            path: path.clone(),
            problem,
        };
        let mut rows = Vec::new();
        if path.exists() {
            let text = std::fs::read_to_string(&path).map_err(|e| broken(e.to_string()))?;
            let mut lines = text.lines();
            let first = lines.next().unwrap_or_default();
            let found: Option<Header> = serde_json::from_str(first).ok();
            if found.as_ref() != Some(&header) {
                let mend = "holds another study: give another --out, or remove the file";
                return Err(broken(mend.into()));
            }
            // The last line of a killed process may be cut short.
            rows = lines.map_while(|l| serde_json::from_str(l).ok()).collect();
        }
        let study = Self {
            subject,
            plan,
            path,
            rows,
        };
        let mut text = serde_json::to_string(&header).expect("plain data serialises") + "\n";
        for row in &study.rows {
            text += &(serde_json::to_string(row).expect("plain data serialises") + "\n");
        }
        trainer::files::write_whole(&study.path, text.as_bytes())?;
        Ok(study)
    }

    /// Measures what is not there yet; `told` hears of each row.
    ///
    /// # Errors
    /// When a choice does not fit the body, a reference does not converge, or the file cannot be written.
    pub fn run(mut self, mut told: impl FnMut(&Row)) -> Result<Vec<Row>> {
        for (question, choices) in self.questions() {
            let is_missing = |c: &Choice| self.row(question, c).is_none();
            let missing: Vec<Choice> = choices.into_iter().filter(is_missing).collect();
            let mut by: Option<(Choice, Simulated)> = None;
            for choice in missing {
                let simulated = Simulated::new(self.subject, &choice)?;
                let error = if question == Question::Network {
                    let shapes = self.subject.shapes()?;
                    let targets: Vec<_> = shapes.iter().map(|s| s.0.positions.clone()).collect();
                    simulated.distance(&targets)
                } else {
                    let reference = self.measured_by(question, &choice);
                    if by.as_ref().is_none_or(|(known, _)| *known != reference) {
                        let what = format!("the reference for {}", words(question));
                        let found = Simulated::reference(self.subject, &reference, &what)?;
                        by = Some((reference, found));
                    }
                    let (_, found) = by.as_ref().expect("just made");
                    simulated.distance(&found.surfaces)
                };
                let row = Row {
                    question,
                    choice,
                    elements: simulated.elements,
                    error,
                    estimated: simulated.estimated,
                    setup: simulated.setup,
                    split: simulated.split,
                    iterations: simulated.iterations,
                    failed: simulated.failed,
                };
                told(&row);
                self.append(row)?;
                if stop_requested() {
                    return Err(AccuracyError::Stopped);
                }
            }
        }
        Ok(self.rows)
    }

    fn row(&self, question: Question, choice: &Choice) -> Option<&Row> {
        let is_it = |row: &&Row| row.question == question && row.choice == *choice;
        self.rows.iter().find(is_it)
    }

    fn append(&mut self, row: Row) -> Result<()> {
        let line = serde_json::to_string(&row).expect("plain data serialises") + "\n";
        let write = || {
            let mut file = OpenOptions::new().append(true).open(&self.path)?;
            file.write_all(line.as_bytes())
        };
        write().map_err(|e: std::io::Error| AccuracyError::Folder {
            path: self.path.clone(),
            problem: format!("cannot be written: {e}"),
        })?;
        self.rows.push(row);
        Ok(())
    }

    /// The choice that a row is measured by: the same but for what is asked about.
    fn measured_by(&self, question: Question, choice: &Choice) -> Choice {
        let mut by = Choice {
            method: Method::Automatic,
            accuracy: self.plan.tight,
            ..choice.clone()
        };
        match question {
            Question::Matrix | Question::Discretisation => {
                by.element_size = self.plan.reference_size * self.base().element_size;
                by.samples = 27;
                by.actuation = ActuationPer::Sample;
            }
            Question::Quadrature => by.samples = 27,
            Question::Points => by.actuation = ActuationPer::Sample,
            Question::Solver | Question::Method | Question::Network => {}
        }
        by
    }

    /// The settings of the scene, solved tightly, with the widest field.
    fn base(&self) -> Choice {
        let field = self.subject.fields.last().expect("at least one field");
        Choice {
            element_size: self.subject.scene.mesh.element_size / self.subject.diagonal,
            samples: 8,
            actuation: ActuationPer::Sample,
            width: field.width,
            method: Method::Automatic,
            accuracy: self.plan.tight,
        }
    }

    fn questions(&self) -> Vec<(Question, Vec<Choice>)> {
        let base = self.base();
        let sized = |share: &f64| Choice {
            element_size: share * base.element_size,
            ..base.clone()
        };
        let with_samples = |samples: usize, actuation: ActuationPer| Choice {
            samples,
            actuation,
            ..base.clone()
        };
        let element = ActuationPer::Element;
        let kinds = [
            with_samples(1, element),
            with_samples(8, element),
            with_samples(8, ActuationPer::Sample),
            with_samples(27, ActuationPer::Sample),
        ];
        let mut matrix = Vec::new();
        for size in &self.plan.sizes {
            for kind in &kinds {
                for &accuracy in &self.plan.accuracies {
                    matrix.push(Choice {
                        element_size: sized(size).element_size,
                        accuracy,
                        ..kind.clone()
                    });
                }
            }
        }
        let fine = |c: Choice| Choice { samples: 27, ..c };
        let sizes = self.plan.sizes.iter();
        let solver = self.plan.accuracies.iter().map(|&accuracy| Choice {
            accuracy,
            ..base.clone()
        });
        // As tight as needed to tell methods apart by their time at the same error.
        let methods = self.plan.methods.iter().map(|&method| Choice {
            method,
            accuracy: *self.plan.accuracies.last().expect("at least one"),
            ..base.clone()
        });
        let networks = self.subject.fields.iter().map(|field| Choice {
            width: field.width,
            ..base.clone()
        });
        let (one, eight) = (with_samples(1, element), kinds[2].clone());
        vec![
            (
                Question::Discretisation,
                sizes.map(sized).map(fine).collect(),
            ),
            (Question::Matrix, matrix),
            (
                Question::Quadrature,
                vec![
                    Choice {
                        actuation: ActuationPer::Sample,
                        ..one
                    },
                    eight,
                ],
            ),
            (Question::Points, vec![kinds[1].clone()]),
            (Question::Solver, solver.collect()),
            (Question::Method, methods.collect()),
            (Question::Network, networks.collect()),
        ]
    }
}

/// The rows that answer a question.
pub fn answers(rows: &[Row], question: Question) -> impl Iterator<Item = &Row> {
    rows.iter().filter(move |row| row.question == question)
}

/// What a question is about.
pub fn words(question: Question) -> &'static str {
    match question {
        Question::Matrix => "all knobs",
        Question::Discretisation => "element size",
        Question::Quadrature => "samples per element",
        Question::Points => "points per element",
        Question::Solver => "accuracy of the solver",
        Question::Method => "method of the solver",
        Question::Network => "network width",
    }
}
