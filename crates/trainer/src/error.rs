//! What can go wrong between a scene file and a trained body.

use crate::frames::{FramesProblem, Place};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Everything that the trainer refuses, with the file, the place and the mend.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TrainerError {
    /// A file that cannot be read or written.
    #[error("cannot {action} {}: {source}", path.display())]
    File {
        /// `read`, `write`, `create` and the like.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A scene file that does not parse, or has a key that is not known.
    #[error("{}:{line}: {message}", path.display())]
    SceneSyntax {
        /// The scene file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong there, with a suggestion where there is one.
        message: String,
    },
    /// A scene value that makes no sense.
    #[error("{}: `{key}` is {value}: {mend}", path.display())]
    SceneValue {
        /// The scene file.
        path: PathBuf,
        /// The key, with its table.
        key: &'static str,
        /// What it holds.
        value: String,
        /// What it may hold.
        mend: &'static str,
    },
    /// A shape that a scene, a weight list or a command names does not exist.
    #[error(
        "{place} names the shape `{name}`, which does not exist; there are: {known}{}",
        suggestion(name, known)
    )]
    UnknownShape {
        /// Where the name stands.
        place: String,
        /// The name.
        name: String,
        /// The names there are.
        known: String,
    },
    /// A shape that describes others is kept from training.
    #[error(
        "`shapes.basis` names `{name}`, which is held out: take it out of one of the two lists"
    )]
    HeldOutBasis {
        /// The shape.
        name: String,
    },
    /// A surface file without morph targets where target shapes are needed.
    #[error("{} has no morph targets: give a glTF file whose mesh has the target shapes as morph targets", path.display())]
    NoTargets {
        /// The file.
        path: PathBuf,
    },
    /// Two files that should hold the same surface differ in their number of vertices.
    #[error(
        "{} has {found} vertices, but the body's surface has {expected}: both need the same vertices in the same order",
        path.display()
    )]
    VertexCount {
        /// The file of target shapes.
        path: PathBuf,
        /// Its vertices.
        found: usize,
        /// Vertices of the neutral surface.
        expected: usize,
    },
    /// A list of blend weights that does not parse.
    #[error("`{text}` is not a list of weights: write name=weight,name=weight with finite weights")]
    WeightList {
        /// What was given.
        text: String,
    },
    /// A file of weights per frame that cannot be used.
    #[error("{}{place}: {problem}", path.display())]
    Frames {
        /// The file.
        path: PathBuf,
        /// Where in it.
        place: Place,
        /// What is wrong there, and the mend.
        problem: FramesProblem,
    },
    /// More frames than one GLB file holds.
    #[error(
        "{frames} frames of {vertices} vertices do not fit a GLB file, which ends at 4 GiB: simulate {most} at a time at most"
    )]
    TooManyFrames {
        /// Frames asked for.
        frames: usize,
        /// Vertices of the surface.
        vertices: usize,
        /// Frames that fit.
        most: usize,
    },
    /// A value on the command line that does not parse or is out of range.
    #[error("`{option} {text}` cannot be used: {mend}")]
    Option {
        /// The option.
        option: &'static str,
        /// What was given.
        text: String,
        /// What may be given.
        mend: &'static str,
    },
    /// An array file that is not what is asked for.
    #[error("{}: {problem}; expected {expected}", path.display())]
    Array {
        /// The npy file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
        /// Type and shape that fit.
        expected: String,
    },
    /// A JSON file that does not hold what it should.
    #[error("{}: {problem}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong and how to mend it.
        problem: String,
    },
    /// A file that does not go with the surface, though it may have as many vertices.
    #[error("{}: {problem}", path.display())]
    Unlike {
        /// The file.
        path: PathBuf,
        /// What differs and how to mend it.
        problem: String,
    },
    /// A bone or an obstacle moves, but nothing says where its joint is.
    #[error(
        "the {what} `{name}` moves, but the scene does not say how: give `jaw.motions` (a JSON file of its motions) or `jaw.pivot`"
    )]
    JawMissing {
        /// `bone` or `obstacle`.
        what: &'static str,
        /// What it is called.
        name: String,
    },
    /// An effect names an obstacle or paint that is not listed.
    #[error(
        "{place} names the {what} `{name}`, which is not listed{}: list it in a table [[{what}]] with this `name` and a `file`{}",
        listed(known),
        suggestion(name, known)
    )]
    UnknownProp {
        /// Where the effect stands.
        place: String,
        /// `obstacle` or `paint`.
        what: &'static str,
        /// The name.
        name: String,
        /// The names there are.
        known: String,
    },
    /// Two obstacles or paints of one name.
    #[error("two tables [[{what}]] have the name `{name}`: give each one of its own")]
    SameName {
        /// `obstacle` or `paint`.
        what: &'static str,
        /// The name.
        name: String,
    },
    /// A line of a file of paint that is no share.
    #[error("{}:{line}: `{found}` is no share: write a number from 0 to 1 on a line for every vertex of the surface", path.display())]
    PaintLine {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What stands there.
        found: String,
    },
    /// Paint for another surface.
    #[error(
        "the paint `{name}` has {found} shares, and the surface {expected} vertices: give one for each, in their order"
    )]
    PaintCount {
        /// What it is called.
        name: String,
        /// Shares of the paint.
        found: usize,
        /// Vertices of the surface.
        expected: usize,
    },
    /// A bone that holds no node of the body.
    #[error(
        "the bone `{bone}`, {across:.3} across, holds no node of the body, which is {body:.3} across: it lies outside of the surface, or inside \
         another bone, is thinner than an element of {element_size}, or its file is in another unit"
    )]
    BoneOutside {
        /// The bone.
        bone: String,
        /// Diagonal of its bounding box.
        across: f64,
        /// Diagonal of the body's bounding box.
        body: f64,
        /// Edge length of an element.
        element_size: f64,
    },
    /// An accuracy that asks for a grid too fine to be used.
    #[error(
        "the accuracy asks for elements of {element_size} {unit}, about {elements:.0} of them: ask for less, or set `mesh.element_size` yourself"
    )]
    GridTooFine {
        /// Edge length of an element.
        element_size: f64,
        /// Elements, about.
        elements: f64,
        /// Unit of the scene.
        unit: String,
    },
    /// A part of the loss that names no vertex.
    #[error("`loss.weights` number {number} {problem}")]
    LossPart {
        /// Which entry, from 1.
        number: usize,
        /// What is wrong and how to mend it.
        problem: String,
    },
    /// A scan that cannot be fitted.
    #[error("the scan {}: {problem}", path.display())]
    Scan {
        /// The file.
        path: PathBuf,
        /// What is wrong and how to mend it.
        problem: String,
    },
    /// A shape that the search cannot start from.
    #[error(
        "`{shape}` cannot be fitted: the equilibrium that the fit starts from is {status:?}; try another --element-size, or a larger `evaluation.accuracy` in the run's scene.toml"
    )]
    FitStart {
        /// The shape.
        shape: String,
        /// How the solver ended.
        status: pd_solver::Status,
    },
    /// A run folder that cannot be used as asked.
    #[error("{}: {problem}", path.display())]
    Run {
        /// The folder.
        path: PathBuf,
        /// What is wrong and how to mend it.
        problem: String,
    },
    /// A checkpoint that does not belong to the run.
    #[error("{}: {problem}", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What is wrong and how to mend it.
        problem: String,
    },
    /// Training steps failed again and again.
    #[error(
        "{count} training steps of stage {stage} in a row failed ({reason}); the last good state is in {}. Train anew with a lower \
         stage{stage}.learning_rate",
        checkpoint.display()
    )]
    Diverged {
        /// Failed steps in a row.
        count: usize,
        /// 1 or 2.
        stage: u8,
        /// Why the last one failed.
        reason: String,
        /// The last good checkpoint.
        checkpoint: PathBuf,
    },
    /// Training steps of the explicit decoder failed again and again.
    #[error(
        "{count} training steps of the explicit decoder in a row failed ({reason}): give another --width, or fewer --seconds"
    )]
    DecoderDiverged {
        /// Failed steps in a row.
        count: usize,
        /// Why the last one failed.
        reason: String,
    },
    /// The disk ended a training; what it had saved is there.
    #[error(
        "{source}; {mend}, and go on with --resume --out {}: nothing up to the last checkpoint is lost",
        run.display()
    )]
    Unfinished {
        /// The run folder.
        run: PathBuf,
        /// What has to be done first.
        mend: &'static str,
        /// What could not be written.
        source: Box<TrainerError>,
    },
    /// Stopped by the user; everything is saved.
    #[error("stopped; go on with --resume --out {}", run.display())]
    Interrupted {
        /// The run folder.
        run: PathBuf,
    },
    /// An evaluation stopped by the user.
    #[error("stopped before the evaluation was finished: what an earlier one wrote is unchanged")]
    EvaluationStopped,
    /// The fit of a grid stopped by the user.
    #[error("stopped before the grid was fitted: nothing is written")]
    GridStopped,
    /// A comparison stopped by the user.
    #[error(
        "stopped before the comparison was finished: no table is new; a decoder that was trained to its end is kept"
    )]
    ComparisonStopped,
    /// A surface that cannot be read or written.
    #[error(transparent)]
    Surface(#[from] surface_mesh::SurfaceError),
    /// A body that cannot be meshed, with the surface's name.
    #[error("{name}: {source}")]
    Mesh {
        /// The surface file or shape.
        name: String,
        /// Why.
        source: hex_mesh::HexMeshError,
    },
    /// A problem that the solver refuses.
    #[error(transparent)]
    Solver(#[from] pd_solver::SolverError),
    /// An effect of a scene that the solver refuses, with its place.
    #[error("{place}: {source}")]
    Effect {
        /// The scene and the line of the effect there.
        place: String,
        /// Why.
        source: pd_solver::SolverError,
    },
    /// A weight in a motion for what does not exist.
    #[error("{}: a key of the motion weighs `{name}`, which is no muscle and no shape; there are: {known}{hint}", path.display())]
    UnknownMover {
        /// The scene.
        path: PathBuf,
        /// The name.
        name: String,
        /// The names there are.
        known: String,
        /// The nearest of them.
        hint: String,
    },
    /// A part of a motion or of an obstacle that selects nothing.
    #[error(
        "nothing lies in the region of `{name}`: look at its numbers, which are in the scene's unit"
    )]
    EmptyPart {
        /// What it is called.
        name: String,
    },
    /// Dynamics without inertia.
    #[error(
        "nothing gives the body inertia: add an effect such as [[effects]] type = \"inertia\", density = 1e-5, time_step = 0.0208333333333 \
         (half a frame at 24 frames per second)"
    )]
    NoInertia,
    /// A step in time that does not divide a frame.
    #[error(
        "a time step of {step} s does not divide a frame of 1/{rate} s: give it 1/{rate} s, or a whole part of that"
    )]
    StepsPerFrame {
        /// The step, in seconds.
        step: f64,
        /// Frames per second.
        rate: f64,
    },
    /// A generated surface without target shapes.
    #[error(
        "a generated solid has no shapes to learn: train a surface from a file or the starfish, or `simulate` this scene"
    )]
    NothingToLearn,
    /// A network that cannot be built, loaded or stepped.
    #[error(transparent)]
    Network(#[from] actuation_net::Error),
    /// Blend weights that cannot be fitted.
    #[error(transparent)]
    Rig(#[from] face_rig::RigError),
    /// A generated shape with impossible measures.
    #[error(transparent)]
    Shape(#[from] scene_shapes::ShapeError),
    /// A picture that cannot be drawn or written.
    #[error(transparent)]
    Report(#[from] report::ReportError),
}

impl TrainerError {
    /// What to do about a disk that took no more, where that is the cause; nothing where the error says it itself.
    pub fn mend(&self) -> Option<&'static str> {
        if matches!(self, Self::Unfinished { .. }) {
            return None;
        }
        let mut cause: Option<&dyn std::error::Error> = Some(self);
        while let Some(error) = cause {
            if let Some(error) = error.downcast_ref::<std::io::Error>() {
                return disk_mend(error.kind());
            }
            cause = error.source();
        }
        None
    }

    /// The same error, with how to go on with a run where the disk ended it.
    pub(crate) fn of_unfinished(self, run: &Path) -> Self {
        match self.mend() {
            None => self,
            Some(mend) => Self::Unfinished {
                run: run.to_path_buf(),
                mend,
                source: Box::new(self),
            },
        }
    }
}

fn disk_mend(kind: ErrorKind) -> Option<&'static str> {
    match kind {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => Some("free some space there"),
        ErrorKind::FileTooLarge => Some("raise the limit on the size of files (ulimit -f)"),
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
            Some("get leave to read and write there")
        }
        _ => None,
    }
}

/// What all functions of this crate return.
pub type Result<T> = std::result::Result<T, TrainerError>;

/// Turns an I/O error into one that names the file.
pub(crate) fn file_error(
    action: &'static str,
    path: &Path,
) -> impl FnOnce(std::io::Error) -> TrainerError {
    let path = path.to_path_buf();
    move |source| TrainerError::File {
        action,
        path,
        source,
    }
}

/// ` (did you mean `x`?)` for the known name nearest to `name`, or nothing.
fn listed(known: &str) -> String {
    match known {
        "" => String::new(),
        names => format!(" (there are: {names})"),
    }
}

pub(crate) fn suggestion(name: &str, known: &str) -> String {
    let names = known.split(", ").map(|k| k.trim_matches('`'));
    let nearest = names
        .map(|k| (strsim::jaro_winkler(name, k), k))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    match nearest {
        Some((score, k)) if score > 0.7 => format!(" (did you mean `{k}`?)"),
        _ => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Error;

    /// Every crate that writes into a run: the cause is found below its error, and the mend follows it.
    #[test]
    fn a_full_disk_says_how_to_go_on_whoever_wrote() {
        let path = PathBuf::from("runs/a/file");
        let full = || Error::from(ErrorKind::StorageFull);
        let all = [
            file_error("write", &path)(full()),
            TrainerError::Network(actuation_net::Error::Write {
                path: path.clone(),
                source: full(),
            }),
            TrainerError::Surface(surface_mesh::SurfaceError::Write {
                path: path.clone(),
                cause: full(),
            }),
            TrainerError::Report(report::ReportError::Write {
                path: path.clone(),
                source: full(),
            }),
        ];
        for error in all {
            assert_eq!(error.mend(), Some("free some space there"), "{error}");
            let whole = error.of_unfinished(Path::new("runs/a"));
            assert_eq!(whole.mend(), None);
            let message = whole.to_string();
            for part in ["runs/a/file", "free some space", "--resume --out runs/a"] {
                assert!(message.contains(part), "{message}");
            }
        }
    }

    #[test]
    fn what_no_disk_did_is_told_as_it_is() {
        let error = file_error("read", Path::new("a"))(Error::from(ErrorKind::NotFound));
        let before = error.to_string();
        assert_eq!(error.mend(), None);
        assert_eq!(error.of_unfinished(Path::new("runs/a")).to_string(), before);
    }
}
