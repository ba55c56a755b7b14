//! The run folder: everything that a training run reads and writes, so that it can be resumed and evaluated anywhere.

use crate::error::{Result, TrainerError, file_error};
use crate::files::{create_folder, remove_unfinished, write_whole};
use crate::scene::Scene;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use surface_mesh::{MorphedSurface, read_surface, write_glb};

/// A run folder that this process holds.
#[derive(Debug)]
pub struct Run {
    folder: PathBuf,
    /// Kept open: the lock lasts as long as the file.
    _lock: File,
}

impl Run {
    /// Starts a new run: the folder gets the scene as used and the input shapes.
    ///
    /// # Errors
    /// When the folder holds a run already or cannot be written.
    pub fn create(folder: &Path, scene_text: &str, inputs: &MorphedSurface) -> Result<Self> {
        create_folder(folder)?;
        let run = Self::lock(folder)?;
        if run.scene_path().exists() {
            let problem = "holds a run already: go on with it by --resume, or give another --out";
            return Err(TrainerError::Run {
                path: folder.to_path_buf(),
                problem: problem.into(),
            });
        }
        write_glb(run.inputs_path(), inputs)?;
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
        Ok(run)
    }

    fn lock(folder: &Path) -> Result<Self> {
        let path = folder.join(".lock");
        let file = File::create(&path).map_err(file_error("create", &path))?;
        if file.try_lock().is_err() {
            return Err(TrainerError::Run {
                path: folder.to_path_buf(),
                problem: "another process works on this run: wait for it or stop it".into(),
            });
        }
        Ok(Self {
            folder: folder.to_path_buf(),
            _lock: file,
        })
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The scene as it was used.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn scene(&self) -> Result<Scene> {
        Ok(Scene::read(&self.scene_path())?.0)
    }

    /// The neutral surface and target shapes. They are kept in single precision; training reads them from here too, so that
    /// what is trained, resumed and evaluated is the same to the last bit.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn inputs(&self) -> Result<MorphedSurface> {
        Ok(read_surface(self.inputs_path())?)
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
    /// Opens the metrics and cuts what was written after the checkpoint that had `length` bytes.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn open(run: &Run, length: u64) -> Result<Self> {
        let path = run.metrics_path();
        let open = || -> std::io::Result<File> {
            let mut options = File::options();
            let file = options.append(true).create(true).open(&path)?;
            if file.metadata()?.len() > length {
                file.set_len(length)?;
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

    /// Bytes written so far.
    pub fn length(&self) -> u64 {
        self.length
    }
}

/// The folder of a run by a scene's name: `runs/NAME`, `runs/NAME-2` and so on. The newest that exists, or the first free one.
pub fn default_folder(name: &str, newest: bool) -> PathBuf {
    let base = Path::new("runs");
    let numbered = |i: usize| match i {
        1 => base.join(name),
        _ => base.join(format!("{name}-{i}")),
    };
    let first_free = (1..).find(|&i| !numbered(i).join("scene.toml").exists());
    let first_free = first_free.expect("some number is free");
    numbered(if newest {
        first_free.max(2) - 1
    } else {
        first_free
    })
}
