//! A service's process: our child, or one that a supervisor before us has left.

use pursuit_messages::Service;
use pursuit_runtime::process::Identity;
use pursuit_runtime::station::SUPERVISOR;
use pursuit_runtime::systemd::NOTIFY_SOCKET;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use std::fs::File;
use std::io;
use std::os::fd::{AsRawFd, OwnedFd};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::Arc;

/// A program file, held open: what is started from it is the same build, also when another one has taken its
/// place on the disk.
#[derive(Clone, Debug)]
pub struct Program {
    path: PathBuf,
    file: Arc<File>,
}

impl Program {
    /// The file that is at `path` now.
    ///
    /// # Errors
    /// The file system's reason.
    pub fn open(path: &Path) -> io::Result<Program> {
        Ok(Program { path: path.to_owned(), file: Arc::new(File::open(path)?) })
    }

    /// What a running process runs.
    fn of(identity: &Identity) -> io::Result<Program> {
        let exe = identity.program();
        Ok(Program { path: std::fs::read_link(&exe)?, file: Arc::new(File::open(exe)?) })
    }

    /// Where it was found.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// How a process ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// As its parent is told.
    Told(ExitStatus),
    /// It was not our child: nobody tells us how.
    Unknown,
}

impl End {
    /// The exit code, where there is one.
    pub fn code(self) -> Option<i32> {
        match self {
            End::Told(status) => status.code(),
            End::Unknown => None,
        }
    }

    /// Whether memory that it shares with the others was not what it must be: SIGBUS, SIGSEGV.
    pub fn is_of_torn_memory(self) -> bool {
        const SIGBUS: i32 = Signal::BUS.as_raw();
        const SIGSEGV: i32 = Signal::SEGV.as_raw();
        match self {
            End::Told(status) => {
                let signal = status.signal().or(status.code().map(|code| code - 128));
                matches!(signal, Some(SIGBUS | SIGSEGV))
            }
            End::Unknown => false,
        }
    }

    /// What is said about it.
    pub fn text(self) -> String {
        match self {
            End::Told(status) => status.to_string(),
            End::Unknown => "it ended".to_owned(),
        }
    }
}

/// The kernel takes no longer to end a process that is not our child; one that waits for a disk may.
const KILL_LIMIT: Timespec = Timespec { tv_sec: 5, tv_nsec: 0 };

/// A running process.
#[derive(Debug)]
pub struct Process {
    identity: Identity,
    handle: OwnedFd,
    child: Option<Child>,
    /// What it runs.
    pub program: Program,
}

impl Process {
    /// Starts `service` for the instance in `directory`.
    ///
    /// # Errors
    /// The operating system's reason, also where the file is no program.
    pub fn spawn(program: &Program, service: Service, directory: &Path) -> io::Result<Process> {
        let log = File::options().create(true).append(true).open(log_file(directory, service))?;
        // By its descriptor: the file may have been replaced meanwhile.
        let mut child = Command::new(format!("/proc/self/fd/{}", program.file.as_raw_fd()))
            .arg0(&program.path)
            .args(["run", service.name(), "--run-dir"])
            .arg(directory)
            .env(SUPERVISOR, Identity::own().to_string())
            .env_remove(NOTIFY_SOCKET)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(log)
            .process_group(0)
            .spawn()?;
        let pid = child.id();
        // Until it is waited for, its number is its own.
        let start = Identity::of(pid).map_or(0, |identity| identity.start);
        match open_handle(pid) {
            Ok(handle) => Ok(Process {
                identity: Identity { pid, start },
                handle,
                child: Some(child),
                program: program.clone(),
            }),
            Err(error) => {
                let _ = child.kill();
                let _ = child.wait();
                Err(error)
            }
        }
    }

    /// One that is running already.
    ///
    /// # Errors
    /// [`io::ErrorKind::NotFound`] where it has ended meanwhile.
    pub fn adopt(identity: Identity) -> io::Result<Process> {
        let handle = open_handle(identity.pid)?;
        let program = Program::of(&identity)?;
        // The handle is of whoever had the number a moment ago: is that still the same one?
        if !identity.lives() {
            return Err(io::ErrorKind::NotFound.into());
        }
        Ok(Process { identity, handle, child: None, program })
    }

    /// Its number.
    pub fn pid(&self) -> u32 {
        self.identity.pid
    }

    /// Which one it is.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// Sends a signal; whether it was there to get it.
    pub fn signal(&self, signal: Signal) -> bool {
        pidfd_send_signal(&self.handle, signal).is_ok()
    }

    /// How it ended, if it has.
    pub fn ended(&mut self) -> Option<End> {
        if let Some(child) = &mut self.child {
            return child.try_wait().ok().flatten().map(End::Told);
        }
        let mut handle = [PollFd::new(&self.handle, PollFlags::IN)];
        let now = Timespec { tv_sec: 0, tv_nsec: 0 };
        matches!(poll(&mut handle, Some(&now)), Ok(1..)).then_some(End::Unknown)
    }

    /// SIGKILL, and waits for the kernel to be done with it.
    pub fn kill(mut self) {
        self.signal(Signal::KILL);
        if let Some(child) = &mut self.child {
            let _ = child.wait();
            return;
        }
        let _ = poll(&mut [PollFd::new(&self.handle, PollFlags::IN)], Some(&KILL_LIMIT));
    }
}

fn open_handle(pid: u32) -> io::Result<OwnedFd> {
    let pid = i32::try_from(pid).ok().and_then(Pid::from_raw).ok_or(io::ErrorKind::NotFound)?;
    Ok(pidfd_open(pid, PidfdFlags::empty())?)
}

/// A service's log in the run-time directory.
pub fn log_file(directory: &Path, service: Service) -> PathBuf {
    directory.join(format!("{}.log", service.name()))
}

/// The last thing that a service has said.
pub fn last_line(directory: &Path, service: Service) -> String {
    let text = std::fs::read_to_string(log_file(directory, service)).unwrap_or_default();
    text.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it gave no reason").to_owned()
}
