//! The scene, the program and the undisturbed run that all others are compared with.

use crate::Result;
use crate::same::{recorded, same};
use myofield_tests::TinyScene;
use std::ffi::OsStr;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// Passes of both stages: most of the time is training, yet start and evaluation are a good part of it.
const EPOCHS: [usize; 2] = [12, 5];

const SIGKILL: i32 = 9;

/// A scene to train, a copy of the program, and what an undisturbed run of it leaves.
pub struct Setting {
    scene: TinyScene,
    program: PathBuf,
    expected: PathBuf,
    whole: Duration,
}

/// One way to start the program.
#[derive(Debug, Clone, Default)]
pub struct Start {
    /// Threads; as many as there are cores unless given.
    pub threads: Option<u32>,
    /// The user it runs as; this one unless given.
    pub user: Option<u32>,
    /// What the shell does before it becomes the program.
    pub shell: Option<String>,
}

/// How the program ended.
#[derive(Debug)]
pub struct Ended {
    /// How the process ended.
    pub status: ExitStatus,
    /// Everything it said on the side.
    pub said: String,
}

impl Ended {
    /// Nothing, where it ended well.
    ///
    /// # Errors
    /// Says how it ended otherwise.
    pub fn succeeds(&self) -> Result<()> {
        match self.status.success() {
            true => Ok(()),
            false => Err(format!("it failed ({}):\n{}", self.status, self.said)),
        }
    }

    /// Whether `kill -9` ended it; no where it had ended well before.
    ///
    /// # Errors
    /// When it ended in any other way.
    pub fn was_killed(&self) -> Result<bool> {
        match self.status.signal() {
            Some(SIGKILL) => Ok(true),
            _ => self.succeeds().map(|()| false),
        }
    }

    /// The line of error, where it refused with exactly one, at the end.
    ///
    /// # Errors
    /// When it ended otherwise.
    pub fn error(&self) -> Result<&str> {
        let mut errors = self.said.lines().filter(|l| l.starts_with("error:"));
        match (errors.next(), errors.next(), self.status.code()) {
            (Some(line), None, Some(1)) => Ok(line),
            _ => Err(format!(
                "it ended without one error ({}):\n{}",
                self.status, self.said
            )),
        }
    }
}

impl Setting {
    /// Writes the scene, copies the program, so that no build changes it, and trains undisturbed.
    ///
    /// The body has more than 400 elements, so that multigrid solves it, and its state is saved after every step.
    ///
    /// # Errors
    /// When the folder cannot be written or the undisturbed training fails.
    pub fn new(program: &Path) -> Result<Self> {
        let scene = TinyScene::new(EPOCHS[0], EPOCHS[1]);
        scene.edit("element_size = 0.4", "element_size = 0.2");
        // Another user has to reach it.
        let open = std::fs::Permissions::from_mode(0o755);
        std::fs::set_permissions(scene.folder(), open).map_err(at(scene.folder()))?;
        let copy = scene.path("myofield");
        std::fs::copy(program, &copy).map_err(at(program))?;
        let mut setting = Self {
            expected: scene.path("undisturbed"),
            whole: Duration::ZERO,
            program: copy,
            scene,
        };
        let clock = Instant::now();
        let expected = setting.expected.clone();
        setting.finish(&expected, &Start::default())?;
        setting.whole = clock.elapsed();
        Ok(setting)
    }

    /// How long the undisturbed run took.
    pub fn whole(&self) -> Duration {
        self.whole
    }

    /// Files and bytes of the undisturbed run.
    pub fn size(&self) -> (usize, usize) {
        let all = recorded(&self.expected);
        (all.len(), all.values().map(Vec::len).sum())
    }

    /// Bytes of the largest file of the undisturbed run.
    pub fn largest(&self) -> usize {
        let all = recorded(&self.expected);
        all.values().map(Vec::len).max().unwrap_or(0)
    }

    /// A place in the setting's folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.scene.path(name)
    }

    /// Starts a training into `run`, or goes on with it where there is a run already.
    ///
    /// # Errors
    /// When the program does not start.
    pub fn start(&self, run: &Path, start: &Start) -> Result<Child> {
        self.start_as(run, start, run.join("scene.toml").exists())
    }

    /// [`Setting::start`] that is told whether to resume.
    ///
    /// # Errors
    /// When the program does not start.
    pub fn start_as(&self, run: &Path, start: &Start, is_resumed: bool) -> Result<Child> {
        let scene = self.scene.scene();
        let mut arguments = vec![
            "train".as_ref(),
            scene.as_os_str(),
            "--out".as_ref(),
            run.as_os_str(),
        ];
        if is_resumed {
            arguments.push("--resume".as_ref());
        }
        self.spawn(&arguments, start)
    }

    /// Starts the program with these arguments, in the folder of the scene.
    ///
    /// # Errors
    /// When it does not start.
    pub fn spawn(&self, arguments: &[&OsStr], start: &Start) -> Result<Child> {
        let mut command = match &start.shell {
            None => Command::new(&self.program),
            Some(words) => {
                let mut shell = Command::new("sh");
                let script = format!("{words}; exec \"$@\"");
                shell.args(["-c", &script, "sh"]).arg(&self.program);
                shell
            }
        };
        command.args(arguments);
        if let Some(threads) = start.threads {
            command.env("RAYON_NUM_THREADS", threads.to_string());
        }
        if let Some(user) = start.user {
            use std::os::unix::process::CommandExt;
            command.uid(user).gid(user);
        }
        command.current_dir(self.scene.folder());
        command.stdin(Stdio::null()).stdout(Stdio::null());
        // What it says fits the pipe many times over.
        command.stderr(Stdio::piped());
        command
            .spawn()
            .map_err(|e| format!("cannot start {}: {e}", self.program.display()))
    }

    /// Trains to the end, or goes on to it.
    ///
    /// # Errors
    /// When the training fails.
    pub fn finish(&self, run: &Path, start: &Start) -> Result<()> {
        wait(self.start(run, start)?)?.succeeds()
    }

    /// The undisturbed run.
    pub fn undisturbed(&self) -> &Path {
        &self.expected
    }

    /// Fails unless a run has left the same bytes as the undisturbed one.
    ///
    /// # Errors
    /// Names the first differences.
    pub fn compare(&self, run: &Path) -> Result<()> {
        same(run, &self.expected)
    }

    /// Goes on with a run to its end, compares it and removes it.
    ///
    /// # Errors
    /// When the training fails or leaves other bytes.
    pub fn conclude(&self, run: &Path, start: &Start) -> Result<()> {
        self.finish(run, start)?;
        self.compare(run)?;
        std::fs::remove_dir_all(run).map_err(at(run))
    }
}

/// Waits for the program.
///
/// # Errors
/// When the system does not tell how it ended.
pub fn wait(child: Child) -> Result<Ended> {
    let output = child.wait_with_output().map_err(|e| e.to_string())?;
    Ok(Ended {
        status: output.status,
        said: String::from_utf8_lossy(&output.stderr).into_owned(),
    })
}

/// Turns an I/O error into one that names the place.
pub fn at(path: &Path) -> impl Fn(std::io::Error) -> String + '_ {
    move |error| format!("{}: {error}", path.display())
}
