//! A system of its own for each test: real processes, a run-time directory of its own, all gone at the end.
#![allow(dead_code)]

use serde_json::Value;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// Generous: a loaded two-core machine must make it. Tests wait for events, this is only the end of hope.
pub const LIMIT: Duration = Duration::from_secs(180);
/// Between two looks at whatever a test waits for.
const LOOK: Duration = Duration::from_millis(20);

/// The program under test.
pub fn pursuit() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pursuit"));
    command.stdin(Stdio::null()).env("PURSUIT_LOG", "warn");
    command
}

/// A run-time directory of its own, removed at the end together with what still runs in it.
pub struct Place {
    pub directory: PathBuf,
}

impl Place {
    pub fn new() -> Place {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let directory = PathBuf::from(format!("/tmp/pt{}-{number}", std::process::id()));
        std::fs::create_dir_all(&directory).expect("a folder below /tmp");
        Place { directory }
    }

    pub fn file(&self, name: &str) -> PathBuf {
        // Not in the run-time directory itself: a cold start sweeps that.
        self.directory.join("files").join(name)
    }

    pub fn run_dir(&self) -> PathBuf {
        self.directory.join("r")
    }

    /// `pursuit VERB …` in this place.
    pub fn command(&self, arguments: &[&str]) -> Command {
        std::fs::create_dir_all(self.directory.join("files")).expect("a folder for files");
        let mut command = pursuit();
        command.args(arguments).arg("--run-dir").arg(self.run_dir());
        command
    }

    /// `pursuit up` with a short training, with more arguments.
    pub fn up(&self, arguments: &[&str]) -> System<'_> {
        let log = std::fs::File::create(self.directory.join("up.log")).expect("a log file");
        let mut command = self.command(&["up"]);
        command.args(["--set", "learner.training_moves=4"]).args(arguments);
        let child = command.stdout(Stdio::piped()).stderr(log).spawn().expect("pursuit up starts");
        System { place: self, child }
    }

    pub fn status(&self) -> Option<Vec<Value>> {
        let output = self.command(&["status", "--json"]).output().expect("pursuit status runs");
        output.status.success().then(|| serde_json::from_slice(&output.stdout).expect("JSON"))
    }

    pub fn log(&self) -> String {
        let mut text = std::fs::read_to_string(self.directory.join("up.log")).unwrap_or_default();
        for entry in std::fs::read_dir(self.run_dir()).into_iter().flatten().flatten() {
            if entry.path().extension().is_some_and(|e| e == "log") {
                let log = std::fs::read_to_string(entry.path()).unwrap_or_default();
                text.push_str(&format!("--- {}\n{log}", entry.path().display()));
            }
        }
        text
    }

    /// Processes that were started for this place and are still there.
    pub fn processes(&self) -> Vec<u32> {
        let wanted = self.run_dir().display().to_string();
        let mut found = Vec::new();
        for entry in std::fs::read_dir("/proc").into_iter().flatten().flatten() {
            let Some(pid) = entry.file_name().to_str().and_then(|name| name.parse::<u32>().ok()) else {
                continue;
            };
            let mut arguments = String::new();
            if let Ok(mut file) = std::fs::File::open(entry.path().join("cmdline")) {
                let mut bytes = Vec::new();
                let _ = file.read_to_end(&mut bytes);
                arguments = String::from_utf8_lossy(&bytes).into_owned();
            }
            let state = std::fs::read_to_string(entry.path().join("stat")).unwrap_or_default();
            let zombie = state.rsplit(')').next().is_some_and(|rest| rest.trim_start().starts_with('Z'));
            if arguments.contains(&wanted) && !zombie && pid != std::process::id() {
                found.push(pid);
            }
        }
        found
    }

    /// Shared-memory objects of this place that exist.
    pub fn shared_memory(&self) -> Vec<PathBuf> {
        let path = self.run_dir().canonicalize().unwrap_or_else(|_| self.run_dir());
        let bytes = path.as_os_str().as_encoded_bytes();
        let hash = bytes.iter().fold(0x811c_9dc5_u32, |h, b| (h ^ u32::from(*b)).wrapping_mul(0x0100_0193));
        let prefix = format!("pur_{hash:08x}_");
        let entries = std::fs::read_dir("/dev/shm").into_iter().flatten().flatten();
        entries.map(|e| e.path()).filter(|p| p.to_string_lossy().contains(&prefix)).collect()
    }

    /// Nothing of this place runs, nothing of it is in shared memory.
    pub fn assert_nothing_left(&self) {
        let gone = wait_for(|| (self.processes().is_empty()).then_some(()));
        assert!(gone.is_some(), "processes left: {:?}\n{}", self.processes(), self.log());
        assert!(self.shared_memory().is_empty(), "shared memory left: {:?}", self.shared_memory());
        assert!(!self.run_dir().join("iox").exists(), "the bus's folder is left");
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        for pid in self.processes() {
            kill(pid, rustix::process::Signal::KILL);
        }
        for object in self.shared_memory() {
            let _ = std::fs::remove_file(object);
        }
        let _ = std::fs::remove_dir_all(&self.directory);
    }
}

/// A running `pursuit up`.
pub struct System<'a> {
    pub place: &'a Place,
    pub child: Child,
}

impl System<'_> {
    /// Waits until every service's heart beats; their states.
    pub fn wait_until_running(&mut self) -> Vec<Value> {
        let states = wait_for(|| {
            let ended = self.child.try_wait().expect("the child is ours");
            assert!(ended.is_none(), "pursuit up ended: {ended:?}\n{}", self.place.log());
            let services = self.place.status()?;
            services.iter().all(|s| s["state"] == "running").then_some(services)
        });
        states.unwrap_or_else(|| panic!("not all services came up\n{}", self.place.log()))
    }

    /// Waits until a service runs in another process than `pid`; all states.
    pub fn wait_until_replaced(&mut self, service: &str, pid: u32) -> Vec<Value> {
        let states = wait_for(|| {
            let services = self.place.status()?;
            let child = services.iter().find(|s| s["service"] == service)?;
            let running = child["state"] == "running" && child["pid"] != pid;
            running.then_some(services)
        });
        states.unwrap_or_else(|| panic!("{service} was not started again\n{}", self.place.log()))
    }

    /// Waits until the journal says that a frame of the phase was answered (0 training, 2 tracking).
    pub fn wait_for_phase(&mut self, phase: u32) {
        let journal = self.place.run_dir().join("journal.csv");
        let wanted = phase.to_string();
        let seen = wait_for(|| {
            let text = std::fs::read_to_string(&journal).ok()?;
            text.lines().skip(1).any(|line| line.split(',').nth(2) == Some(wanted.as_str())).then_some(())
        });
        assert!(seen.is_some(), "phase {phase} was never reached\n{}", self.place.log());
    }

    pub fn signal(&self, signal: rustix::process::Signal) {
        kill(self.child.id(), signal);
    }

    /// Waits for the end; its status and standard output.
    pub fn end(&mut self) -> (ExitStatus, String) {
        let status = wait_for(|| self.child.try_wait().expect("the child is ours"));
        let status = status.unwrap_or_else(|| panic!("pursuit up does not end\n{}", self.place.log()));
        let mut text = String::new();
        if let Some(out) = self.child.stdout.as_mut() {
            let _ = out.read_to_string(&mut text);
        }
        (status, text)
    }
}

impl Drop for System<'_> {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Looks until there is something, `None` after [`LIMIT`].
pub fn wait_for<T>(mut look: impl FnMut() -> Option<T>) -> Option<T> {
    let end = Instant::now() + LIMIT;
    loop {
        if let Some(found) = look() {
            return Some(found);
        }
        if Instant::now() > end {
            return None;
        }
        std::thread::sleep(LOOK);
    }
}

pub fn kill(pid: u32, signal: rustix::process::Signal) {
    if let Some(pid) = rustix::process::Pid::from_raw(pid as i32) {
        let _ = rustix::process::kill_process(pid, signal);
    }
}

/// The pid of a service in a status.
pub fn pid_of(services: &[Value], name: &str) -> u32 {
    let service = services.iter().find(|s| s["service"] == name).expect("the service is in the status");
    u32::try_from(service["pid"].as_u64().expect("a pid")).expect("a pid")
}

pub fn json(file: &Path) -> Value {
    let text = std::fs::read_to_string(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    serde_json::from_str(&text).expect("JSON")
}

pub fn text(output: &Output) -> (String, String) {
    (
        String::from_utf8_lossy(&output.stdout).into_owned(),
        String::from_utf8_lossy(&output.stderr).into_owned(),
    )
}
