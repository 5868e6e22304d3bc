//! What systemd is told, where it has started this process (sd_notify(3)); else nothing is told to nobody.

use sd_notify::NotifyState;

/// The variable that says where to.
pub const NOTIFY_SOCKET: &str = "NOTIFY_SOCKET";

/// What has been told.
#[derive(Debug)]
pub struct Systemd {
    is_ready: bool,
    /// Time between two signs of life, ns; `None` where nobody watches.
    period_ns: Option<u64>,
    next_ns: u64,
    said: String,
}

impl Default for Systemd {
    fn default() -> Systemd {
        // Half of what systemd waits for is its own advice; a third survives one late turn.
        let period_ns = sd_notify::watchdog_enabled().map(|limit| limit.as_nanos() as u64 / 3);
        Systemd { is_ready: false, period_ns, next_ns: 0, said: String::new() }
    }
}

impl Systemd {
    /// Everything is up; told once.
    pub fn ready(&mut self) {
        if !self.is_ready {
            self.is_ready = true;
            tell(&[NotifyState::Ready]);
        }
    }

    /// A sign of life, if it is time for one.
    pub fn lives(&mut self, now_ns: u64) {
        if let Some(period_ns) = self.period_ns.filter(|_| now_ns >= self.next_ns) {
            self.next_ns = now_ns + period_ns;
            tell(&[NotifyState::Watchdog]);
        }
    }

    /// A line for `systemctl status`, if it is another one than the last.
    pub fn tell(&mut self, line: &str) {
        if self.said != line {
            line.clone_into(&mut self.said);
            tell(&[NotifyState::Status(line)]);
        }
    }
}

/// The end begins.
pub fn stopping() {
    tell(&[NotifyState::Stopping]);
}

/// A manager that does not listen is no reason to do anything.
fn tell(states: &[NotifyState<'_>]) {
    let _ = sd_notify::notify(states);
}
