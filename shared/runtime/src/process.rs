//! Which process, for all time, and what the kernel knows of its work.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

/// A process: its number is used again, number and start together are not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Its number.
    pub pid: u32,
    /// When it was started, clock ticks after the machine's start.
    pub start: u64,
}

impl Identity {
    /// This process.
    pub fn own() -> Identity {
        let pid = std::process::id();
        Identity::of(pid).unwrap_or(Identity { pid, start: 0 })
    }

    /// The process that has the number `pid` now; `None` where there is none, or only what its parent has not
    /// asked for yet (a zombie).
    pub fn of(pid: u32) -> Option<Identity> {
        let stat = stat(pid)?;
        let start = stat.field(START)?.parse().ok()?;
        (!matches!(stat.state(), 'Z' | 'X')).then_some(Identity { pid, start })
    }

    /// Whether it lives.
    pub fn lives(&self) -> bool {
        Identity::of(self.pid) == Some(*self)
    }

    /// The file that it runs, which may have been replaced or removed meanwhile: opening this opens the one it
    /// runs all the same.
    pub fn program(&self) -> PathBuf {
        PathBuf::from(format!("/proc/{}/exe", self.pid))
    }

    /// What it is doing now; `None` where it is gone.
    pub fn activity(&self) -> Option<Activity> {
        let stat = stat(self.pid)?;
        let times = std::fs::read_to_string(format!("/proc/{}/schedstat", self.pid)).ok()?;
        let mut times = times.split_ascii_whitespace().map(|word| word.parse().unwrap_or(0));
        Some(Activity { state: stat.state(), ran_ns: times.next()?, turns: times.nth(1)? })
    }
}

impl fmt::Display for Identity {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.pid, self.start)
    }
}

impl FromStr for Identity {
    type Err = ();

    fn from_str(text: &str) -> Result<Identity, ()> {
        let mut words = text.split_ascii_whitespace().map(str::parse::<u64>);
        match (words.next(), words.next(), words.next()) {
            (Some(Ok(pid)), Some(Ok(start)), None) => {
                Ok(Identity { pid: u32::try_from(pid).map_err(|_| ())?, start })
            }
            _ => Err(()),
        }
    }
}

/// What the kernel says about the main thread of a process (proc(5): stat, schedstat).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Activity {
    /// R runs or waits for a core, S sleeps, D waits for a disk, T is stopped, t is held by a debugger.
    pub state: char,
    /// Time on a core so far, ns.
    pub ran_ns: u64,
    /// How often it was given a core.
    pub turns: u64,
}

/// From now on this thread takes the core from nobody when it wakes up (SCHED_BATCH, sched(7)). Work at idle time
/// must besides pause often. SCHED_IDLE would need no pauses, but a process that has such a thread does not die of
/// SIGKILL before the thread gets a core once more: on a busy machine that was up to 0.9 s.
pub fn give_way() {
    use thread_priority::{
        NormalThreadSchedulePolicy, ThreadPriority, ThreadSchedulePolicy, set_thread_priority_and_policy,
        thread_native_id,
    };
    let batch = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Batch);
    // Who may not goes on as it is.
    let _ = set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Min, batch);
}

/// Fields of /proc/PID/stat are counted from the one after the name.
const START: usize = 19;

struct Stat(String);

fn stat(pid: u32) -> Option<Stat> {
    let text = std::fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name, in parentheses, may hold anything.
    text.rsplit_once(") ").map(|(_, rest)| Stat(rest.to_owned()))
}

impl Stat {
    fn field(&self, number: usize) -> Option<&str> {
        self.0.split_ascii_whitespace().nth(number)
    }

    fn state(&self) -> char {
        self.0.chars().next().unwrap_or('?')
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::process::Command;

    #[test]
    fn a_process_is_itself_until_it_ends() {
        let mut child = Command::new("sleep").arg("1000").spawn().unwrap();
        let identity = Identity::of(child.id()).unwrap();
        assert!(identity.lives());
        assert!(!Identity { start: identity.start + 1, ..identity }.lives(), "another one of that number");
        assert_eq!(identity.to_string().parse(), Ok(identity));
        child.kill().unwrap();
        // Dead, but not waited for: a zombie does not live.
        while identity.lives() {
            std::thread::yield_now();
        }
        child.wait().unwrap();
        assert_eq!(Identity::of(identity.pid), None);
    }

    #[test]
    fn what_is_no_identity_is_none() {
        for text in ["", "12", "12 x", "-1 4", "12 4 5", "99999999999 4"] {
            assert_eq!(text.parse::<Identity>(), Err(()), "{text:?}");
        }
    }

    #[test]
    fn work_shows() {
        let own = Identity::own();
        let before = own.activity().unwrap();
        assert_eq!(Identity::of(own.pid), Some(own));
        assert!(before.ran_ns > 0 && before.turns > 0);
    }
}
