//! What can be wrong with a source, where, and how to mend it.

use std::path::PathBuf;

use surface_mesh::SurfaceError;

/// Why a source could not be imported.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// What was given holds nothing that looks like the source.
    #[error("{}: no {marker} in it or in the folders where it usually lies. {obtain}", place.display())]
    NotTheSource {
        /// The folder or archive that was given.
        place: PathBuf,
        /// The file that the source is known by.
        marker: &'static str,
        /// Where to get the source.
        obtain: &'static str,
    },
    /// Files that the source should have are not there.
    #[error("{}: missing {}. {obtain}", place.display(), listed(files))]
    Missing {
        /// The folder or archive in which they were looked for.
        place: PathBuf,
        /// The files, relative to it.
        files: Vec<String>,
        /// Where to get the source.
        obtain: &'static str,
    },
    /// A file or folder that cannot be read or written.
    #[error("cannot {action} {}: {cause}", path.display())]
    File {
        /// `read`, `write` and the like.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        cause: std::io::Error,
    },
    /// An archive that is damaged, or no zip file at all.
    #[error("{}: {cause}; give an unpacked folder, or a whole zip file or wheel", path.display())]
    Archive {
        /// The archive.
        path: PathBuf,
        /// What is wrong with it.
        cause: zip::result::ZipError,
    },
    /// A packed file that unpacks to far more than a file of the source could.
    #[error("{}: its {packed} packed bytes unpack to more than {most}; that is no file of this source, get it anew", path.display())]
    Bomb {
        /// The file.
        path: PathBuf,
        /// Its size as it is packed.
        packed: u64,
        /// The most bytes that are believed.
        most: u64,
    },
    /// A place holder of Git LFS instead of the file.
    #[error("{}: only a pointer of Git LFS; fetch the file itself with `git lfs pull`", path.display())]
    LfsPointer {
        /// The file.
        path: PathBuf,
    },
    /// A mesh of another number of vertices than the source has.
    #[error("{}: {found} vertices instead of {expected}; is it another edition of the source?", path.display())]
    VertexCount {
        /// The mesh.
        path: PathBuf,
        /// Its vertices.
        found: usize,
        /// Vertices that it should have.
        expected: usize,
    },
    /// A polygon with corners inside and outside of a part.
    #[error("{}: polygon {polygon} joins the part {part} to another one; is it another edition of the source?", path.display())]
    Straddles {
        /// The mesh.
        path: PathBuf,
        /// Name of the part.
        part: &'static str,
        /// The polygon, from 0.
        polygon: usize,
    },
    /// A border that touches itself, which no fan can close.
    #[error(
        "{name}: more than one hole ends at vertex {vertex}, so the holes cannot be closed one by one; \
         separate them there"
    )]
    TouchingHoles {
        /// What is to be closed.
        name: String,
        /// The vertex, from 0.
        vertex: u32,
    },
    /// A surface that bounds no solid though its holes were closed.
    #[error("{name} bounds no solid: {report}")]
    NotSolid {
        /// Which surface.
        name: String,
        /// What is wrong with it.
        report: Box<surface_mesh::SurfaceReport>,
    },
    /// A line of a MakeHuman target file that is no displacement.
    #[error("{}:{line}: `{text}` is not a vertex number and three finite numbers", path.display())]
    TargetLine {
        /// The target file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What stands there.
        text: String,
    },
    /// A file names a vertex that the mesh has not got.
    #[error("{}: vertex {vertex} does not exist, the mesh has {vertices}", path.display())]
    VertexBeyond {
        /// The file.
        path: PathBuf,
        /// The vertex, from 0.
        vertex: usize,
        /// Vertices of the mesh.
        vertices: usize,
    },
    /// A JSON file that does not hold what it should.
    #[error("{}: {cause}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// What is wrong, with line and column.
        cause: serde_json::Error,
    },
    /// A name that a file should define and does not.
    #[error("{}: no {kind} `{name}`", path.display())]
    UnknownName {
        /// The file.
        path: PathBuf,
        /// `bone` or `vertex group`.
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// A vertex that no bone moves.
    #[error("{}: no bone has a weight at vertex {vertex}", path.display())]
    NoWeight {
        /// The file of weights.
        path: PathBuf,
        /// The vertex, from 0.
        vertex: usize,
    },
    /// Bones whose parents lead in a circle.
    #[error("{}: the parents of bone `{name}` lead to no root", path.display())]
    NoRoot {
        /// The file of the rig.
        path: PathBuf,
        /// The bone.
        name: String,
    },
    /// Points for a rigid fit that differ in number, or none at all.
    #[error(
        "a rigid motion needs the same number of points before and after it, at least one: {from} and {to} were given"
    )]
    PointCount {
        /// Points before the motion.
        from: usize,
        /// Points after it.
        to: usize,
    },
    /// The folder to be written is there already.
    #[error("{} is there already: remove it, or give another --out", path.display())]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// A surface that cannot be read, built or written.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
}

/// What all functions of this crate return.
pub type Result<T> = std::result::Result<T, ImportError>;

/// The first few names of a list, and how many more there are.
fn listed(names: &[String]) -> String {
    const SHOWN: usize = 6;
    let shown = names[..names.len().min(SHOWN)].join(", ");
    match names.len().saturating_sub(SHOWN) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

/// Turns an I/O error into one that names the file.
pub(crate) fn file_error(
    action: &'static str,
    path: impl Into<PathBuf>,
) -> impl FnOnce(std::io::Error) -> ImportError {
    let path = path.into();
    move |cause| ImportError::File {
        action,
        path,
        cause,
    }
}
