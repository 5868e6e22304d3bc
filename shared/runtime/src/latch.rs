//! Stops and wishes of an operator, as files of the run-time directory.
//!
//! A stop is a file that is there: no process has to live for it, no content can be half written, and it
//! outlives driver, supervisor and run. Whoever cannot look whether it is there takes it as there.

use rustix::fs::{AtFlags, CWD, Mode, OFlags, fstat, openat, statat, unlinkat};
use rustix::io::Errno;
use std::os::fd::OwnedFd;
use std::path::Path;

/// A stop that outlives the driver.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Latch {
    /// Protective stop.
    Protective,
    /// Emergency stop.
    Emergency,
}

/// What an operator wants.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wish {
    /// Out of a stop.
    Reset,
    /// Follow set-points.
    Activate,
}

const LATCHES: [(Latch, &str); 2] =
    [(Latch::Emergency, "stop.emergency"), (Latch::Protective, "stop.protective")];
const WISHES: [(Wish, &str); 2] = [(Wish::Reset, "wish.reset"), (Wish::Activate, "wish.activate")];

/// The files of one instance.
pub struct Latches {
    directory: OwnedFd,
}

impl Latches {
    /// Those in the run-time directory.
    ///
    /// # Errors
    /// The file system's reason.
    pub fn open(directory: &Path) -> std::io::Result<Latches> {
        let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC;
        Ok(Latches { directory: openat(CWD, directory, flags, Mode::empty())? })
    }

    /// The strongest stop that is set. A directory that is gone or cannot be read is an emergency stop.
    pub fn set(&self) -> Option<Latch> {
        if fstat(&self.directory).map_or(true, |directory| directory.st_nlink == 0) {
            return Some(Latch::Emergency);
        }
        LATCHES.into_iter().find(|(_, name)| self.is_there(name)).map(|(latch, _)| latch)
    }

    /// Sets a stop; one that is set stays.
    ///
    /// # Errors
    /// The file system's reason: the stop may not outlive the driver then.
    pub fn latch(&self, latch: Latch) -> std::io::Result<()> {
        LATCHES.into_iter().filter(|(one, _)| *one == latch).try_for_each(|(_, name)| self.make(name))
    }

    /// Takes all stops away. One that cannot be taken away stays and counts.
    ///
    /// # Errors
    /// The file system's reason.
    pub fn release(&self) -> std::io::Result<()> {
        LATCHES.into_iter().try_for_each(|(_, name)| self.remove(name))
    }

    /// Wishes for something; the driver takes it at its next look.
    ///
    /// # Errors
    /// The file system's reason.
    pub fn wish(&self, wish: Wish) -> std::io::Result<()> {
        WISHES.into_iter().filter(|(one, _)| *one == wish).try_for_each(|(_, name)| self.make(name))
    }

    /// Whether a wish waits to be taken up.
    pub fn wishes_for(&self, wish: Wish) -> bool {
        WISHES.into_iter().any(|(one, name)| one == wish && self.is_there(name))
    }

    /// Takes a wish up, which is then gone: a button that is held down counts once. One that cannot be taken
    /// away is none.
    pub fn take_wish(&self) -> Option<Wish> {
        WISHES
            .into_iter()
            .find(|(_, name)| self.is_there(name) && self.remove(name).is_ok())
            .map(|(wish, _)| wish)
    }

    /// Forgets all wishes: those from before a driver's start are not meant for it.
    pub fn forget_wishes(&self) {
        for (_, name) in WISHES {
            let _ = self.remove(name);
        }
    }

    fn is_there(&self, name: &str) -> bool {
        !matches!(statat(&self.directory, name, AtFlags::SYMLINK_NOFOLLOW), Err(Errno::NOENT))
    }

    fn make(&self, name: &str) -> std::io::Result<()> {
        let flags = OFlags::WRONLY | OFlags::CREATE | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        openat(&self.directory, name, flags, Mode::RUSR | Mode::WUSR)?;
        Ok(())
    }

    fn remove(&self, name: &str) -> std::io::Result<()> {
        match unlinkat(&self.directory, name, AtFlags::empty()) {
            Ok(()) | Err(Errno::NOENT) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }
}
