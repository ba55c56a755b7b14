//! The run folder: everything that a training run reads and writes, so that it can be resumed and evaluated anywhere.

use crate::error::{Result, TrainerError, file_error};
use crate::files::{create_folder, read_json, remove_unfinished, write_json, write_whole};
use crate::performance::PERFORMANCE;
use crate::rig::Rig;
use crate::scene::{Basis, Scene};
use crate::shapes::ChosenBasis;
use std::fs::{File, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};
use surface_mesh::{MorphedSurface, read_surface, write_glb};

/// The file that a process holds while it works on a run; the first that a run gets, and empty.
const LOCK: &str = ".lock";

/// A run folder that this process holds.
#[derive(Debug)]
pub struct Run {
    folder: PathBuf,
    /// Kept open: the lock lasts as long as the file.
    _lock: File,
}

impl Run {
    /// Starts a new run: the folder gets the scene as used, the input shapes, the bones, and the basis where it was chosen. Unfinished
    /// files of a process that was killed while it did this are removed.
    ///
    /// # Errors
    /// When the folder holds a run already or cannot be written.
    pub fn create(
        folder: &Path,
        scene_text: &str,
        inputs: &MorphedSurface,
        rig: &Rig,
        basis: Option<&ChosenBasis>,
    ) -> Result<Self> {
        create_folder(folder)?;
        // Without one, nobody began a run here, and what lies here is not ours.
        let is_begun = folder.join(LOCK).exists();
        let run = Self::lock(folder)?;
        if run.scene_path().exists() {
            let problem = "holds a run already: go on with it by --resume, or give another --out";
            return Err(TrainerError::Run {
                path: folder.to_path_buf(),
                problem: problem.into(),
            });
        }
        if is_begun {
            remove_unfinished(folder)?;
            remove_unfinished(&run.rig_folder())?;
        }
        write_glb(run.inputs_path(), inputs)?;
        rig.write(&run.rig_folder())?;
        if let Some(basis) = basis {
            write_json(&run.basis_path(), basis)?;
        }
        // Last: a folder with a scene is a run.
        write_whole(&run.scene_path(), scene_text.as_bytes())?;
        Ok(run)
    }

    /// Opens a run that exists, and removes the unfinished files that a killed process left there.
    ///
    /// # Errors
    /// When the folder holds no run, or another process works on it.
    pub fn open(folder: &Path) -> Result<Self> {
        if !folder.join("scene.toml").exists() {
            return Err(TrainerError::Run {
                path: folder.to_path_buf(),
                problem: "holds no run (no scene.toml): train one first, or give the folder that training printed".into(),
            });
        }
        let run = Self::lock(folder)?;
        remove_unfinished(folder)?;
        remove_unfinished(&run.evaluation_folder())?;
        remove_unfinished(&run.evaluation_folder().join(PERFORMANCE))?;
        remove_unfinished(&run.comparison_folder())?;
        Ok(run)
    }

    fn lock(folder: &Path) -> Result<Self> {
        let path = folder.join(LOCK);
        refuse_link(&path)?;
        let file = File::create(&path).map_err(file_error("create", &path))?;
        // The system takes the lock back when a process ends, however it ends: none is ever stale.
        file.try_lock().map_err(|error| match error {
            TryLockError::WouldBlock => TrainerError::Run {
                path: folder.to_path_buf(),
                problem: "another process works on this run: wait for it or stop it".into(),
            },
            TryLockError::Error(source) => file_error("lock", &path)(source),
        })?;
        Ok(Self {
            folder: folder.to_path_buf(),
            _lock: file,
        })
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The scene as it was used, with the names of the basis shapes where it asks for a number of them.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn scene(&self) -> Result<Scene> {
        let mut scene = Scene::read(&self.scene_path())?.0;
        if let Some(Basis::Count(_)) = scene.shapes.basis {
            let chosen: ChosenBasis = read_json(&self.basis_path())?;
            scene.shapes.basis = Some(Basis::Names(chosen.basis));
        }
        Ok(scene)
    }

    fn basis_path(&self) -> PathBuf {
        self.folder.join("basis.json")
    }

    /// The neutral surface and target shapes. They are kept in single precision; training reads them from here too, so that
    /// what is trained, resumed and evaluated is the same to the last bit.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn inputs(&self) -> Result<MorphedSurface> {
        Ok(read_surface(self.inputs_path())?)
    }

    /// The bones, kept as the shapes are.
    ///
    /// # Errors
    /// When a file cannot be read.
    pub fn rig(&self) -> Result<Rig> {
        Rig::read(&self.rig_folder())
    }

    fn rig_folder(&self) -> PathBuf {
        self.folder.join("rig")
    }

    fn scene_path(&self) -> PathBuf {
        self.folder.join("scene.toml")
    }

    fn inputs_path(&self) -> PathBuf {
        self.folder.join("inputs.glb")
    }

    /// The checkpoint that training resumes from.
    pub fn checkpoint_path(&self) -> PathBuf {
        self.folder.join("checkpoint.safetensors")
    }

    /// The trained network.
    pub fn model_path(&self) -> PathBuf {
        self.folder.join("model.safetensors")
    }

    /// The folder of the last evaluation.
    pub fn evaluation_folder(&self) -> PathBuf {
        self.folder.join("evaluation")
    }

    /// The folder of the comparison with other methods.
    pub fn comparison_folder(&self) -> PathBuf {
        self.folder.join("comparison")
    }

    /// The metrics, a JSON object per line.
    pub fn metrics_path(&self) -> PathBuf {
        self.folder.join("metrics.jsonl")
    }
}

/// Appends lines to the metrics of a run.
pub struct Metrics {
    file: File,
    path: PathBuf,
    length: u64,
}

impl Metrics {
    /// Opens the metrics and cuts what was written after the checkpoint that had `length` bytes, and a last line that is not whole.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn open(run: &Run, length: u64) -> Result<Self> {
        let path = run.metrics_path();
        refuse_link(&path)?;
        let open = || -> std::io::Result<File> {
            let mut options = File::options();
            let file = options.append(true).create(true).open(&path)?;
            match file.metadata()?.len() {
                more if more > length => file.set_len(length)?,
                // Somebody cut it, or a disk lost its end.
                less if less < length => file.set_len(whole_lines(&path)?)?,
                _ => {}
            }
            Ok(file)
        };
        let file = open().map_err(file_error("write", &path))?;
        let length = file.metadata().map_err(file_error("read", &path))?.len();
        Ok(Self { file, path, length })
    }

    /// Appends one line.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn append(&mut self, line: &serde_json::Value) -> Result<()> {
        let text = format!("{line}\n");
        let write = self.file.write_all(text.as_bytes());
        write.map_err(file_error("write", &self.path))?;
        self.length += text.len() as u64;
        Ok(())
    }

    /// Waits until every line is on the disk.
    ///
    /// # Errors
    /// When the disk fails.
    pub fn sync(&self) -> Result<()> {
        self.file
            .sync_data()
            .map_err(file_error("write", &self.path))
    }

    /// Bytes written so far.
    pub fn length(&self) -> u64 {
        self.length
    }
}

/// Bytes of a file up to its last line end.
fn whole_lines(path: &Path) -> std::io::Result<u64> {
    let bytes = std::fs::read(path)?;
    let last = bytes.iter().rposition(|&b| b == b'\n');
    Ok(last.map_or(0, |at| at as u64 + 1))
}

/// Refuses a symbolic link where a file is written in place. All other outputs replace what stands under their name, a link too, and leave
/// alone what it points to; this one would be emptied or cut.
fn refuse_link(path: &Path) -> Result<()> {
    if !path.is_symlink() {
        return Ok(());
    }
    Err(TrainerError::Run {
        path: path.to_path_buf(),
        problem: "is a symbolic link, and what it points to would be overwritten: remove the link"
            .into(),
    })
}

/// The newest run of a scene under the folder `runs`: `NAME`, or the `NAME-i` with the highest number. `NAME` where there is none.
pub fn newest_folder(runs: &Path, name: &str) -> PathBuf {
    numbered(runs, name, newest(runs, name).max(1))
}

/// Where the next run of a scene goes: behind the newest, whether or not older ones were deleted.
pub fn next_folder(runs: &Path, name: &str) -> PathBuf {
    numbered(runs, name, newest(runs, name) + 1)
}

fn numbered(runs: &Path, name: &str, number: u64) -> PathBuf {
    match number {
        1 => runs.join(name),
        _ => runs.join(format!("{name}-{number}")),
    }
}

/// The highest number of a run; 0 where there is none.
fn newest(runs: &Path, name: &str) -> u64 {
    let Ok(entries) = std::fs::read_dir(runs) else {
        return 0;
    };
    let number = |entry: std::fs::DirEntry| -> Option<u64> {
        let folder = entry.file_name();
        let number = match folder.to_str()?.strip_prefix(name)? {
            "" => 1,
            rest => rest.strip_prefix('-')?.parse().ok()?,
        };
        // Not `NAME-1` or `NAME-02`, which no run of this scene is called.
        let is_run = entry.path() == numbered(runs, name, number)
            && number < u64::MAX
            && entry.path().join("scene.toml").exists();
        is_run.then_some(number)
    };
    entries.flatten().filter_map(number).max().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture;
    use serde_json::json;

    fn run(folder: &Path) -> Run {
        Run::create(
            folder,
            fixture::SCENE,
            &fixture::inputs(),
            &Rig::default(),
            None,
        )
        .unwrap()
    }

    #[test]
    fn folders_are_numbered_behind_the_newest() {
        let runs = tempfile::tempdir().unwrap();
        let next = || next_folder(runs.path(), "ball");
        let newest = || newest_folder(runs.path(), "ball");
        assert_eq!(next(), runs.path().join("ball"));
        assert_eq!(newest(), runs.path().join("ball"));
        run(&next());
        assert_eq!(newest(), runs.path().join("ball"));
        assert_eq!(next(), runs.path().join("ball-2"));
        run(&next());
        run(&next());
        assert_eq!(newest(), runs.path().join("ball-3"));
        // What begins alike is not a run of this scene, and a folder without a scene is none.
        for other in ["ball-x", "ball-02", "ball-1", "ball-7b", "balloon", "ball-"] {
            run(&runs.path().join(other));
        }
        std::fs::create_dir(runs.path().join("ball-9")).unwrap();
        assert_eq!(newest(), runs.path().join("ball-3"));
        // A number is not taken again when an older run is deleted: the newest stays the newest.
        std::fs::remove_dir_all(runs.path().join("ball")).unwrap();
        assert_eq!(newest(), runs.path().join("ball-3"));
        assert_eq!(next(), runs.path().join("ball-4"));
    }

    #[test]
    fn a_run_is_held_by_one_and_made_once() {
        let folder = tempfile::tempdir().unwrap();
        let held = run(folder.path());
        let message = |refused: Result<Run>| refused.unwrap_err().to_string();
        assert!(message(Run::open(folder.path())).contains("another process"));
        drop(held);
        Run::open(folder.path()).unwrap();
        let again = Run::create(
            folder.path(),
            fixture::SCENE,
            &fixture::inputs(),
            &Rig::default(),
            None,
        );
        assert!(message(again).contains("--resume"));
    }

    /// A process killed while it made a run left half an `inputs.glb` under another name, and the run made there afterwards kept it.
    #[test]
    fn what_a_killed_beginning_left_goes_and_files_of_others_stay() {
        let folder = tempfile::tempdir().unwrap();
        let left = folder.path().join(".part-Ab12Cd");
        std::fs::write(&left, "half").unwrap();
        drop(run(folder.path()));
        assert!(left.exists(), "it was there before any run");
        std::fs::remove_file(folder.path().join("scene.toml")).unwrap();
        run(folder.path());
        assert!(!left.exists());
    }

    #[test]
    fn metrics_are_cut_to_the_checkpoint() {
        let folder = tempfile::tempdir().unwrap();
        let run = run(folder.path());
        let text = || std::fs::read_to_string(run.metrics_path()).unwrap();
        let mut metrics = Metrics::open(&run, 0).unwrap();
        metrics.append(&json!({ "step": 0 })).unwrap();
        let saved = metrics.length();
        metrics.append(&json!({ "step": 1 })).unwrap();
        drop(metrics);
        // A line that a killed process did not finish.
        let whole = text();
        std::fs::write(run.metrics_path(), whole + "{\"st").unwrap();
        let mut metrics = Metrics::open(&run, saved).unwrap();
        assert_eq!(metrics.length(), saved);
        metrics.append(&json!({ "step": 1 })).unwrap();
        assert_eq!(text(), "{\"step\":0}\n{\"step\":1}\n");
        assert_eq!(metrics.length(), text().len() as u64);
        // A disk that lost the end: whole lines stay.
        drop(metrics);
        std::fs::write(run.metrics_path(), "{\"step\":0}\n{\"st").unwrap();
        let mut metrics = Metrics::open(&run, 24).unwrap();
        metrics.append(&json!({ "step": 1 })).unwrap();
        assert_eq!(text(), "{\"step\":0}\n{\"step\":1}\n");
        // Somebody deleted it: training goes on with what there is.
        drop(metrics);
        std::fs::remove_file(run.metrics_path()).unwrap();
        assert_eq!(Metrics::open(&run, saved).unwrap().length(), 0);
    }
}
