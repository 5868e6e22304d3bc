//! The system under test: real processes, and what is done to them.

use super::plan::{Fault, Lie};
use pursuit_acquisition::fault::Fault as CameraFault;
use pursuit_bus::{Bus, Instance, Publisher};
use pursuit_messages::topics::SetPoints;
use pursuit_messages::{Service, SetPoint, Stage, Stamp};
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::latch::{Latch, Latches, Wish};
use pursuit_runtime::place;
use pursuit_runtime::process::Identity;
use pursuit_supervisor::control::{Answer, Request, ask};
use pursuit_supervisor::process::Process;
use rustix::process::Signal;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};

/// What every run has; the options of the command line come after it.
const SETTINGS: [&str; 6] = [
    "acquisition.faults=true",
    "run.clock=wall",
    "camera.rate_hz=25",
    "learner.training_moves=12",
    "observer.start=never",
    "arm.activate=automatic",
];

/// A running system.
pub struct System {
    directory: PathBuf,
    settings: Vec<String>,
    up: Child,
    latches: Latches,
    /// Outcomes of planned restarts.
    outcomes: (Sender<Outcome>, Receiver<Outcome>),
}

/// How a planned restart went.
pub struct Outcome {
    /// Of which service.
    pub service: Service,
    /// When it was asked for and when the answer came, ns.
    pub times_ns: (u64, u64),
    /// Why it was refused, if it was.
    pub refused: Option<String>,
}

impl System {
    /// Starts one in `directory`.
    ///
    /// # Errors
    /// The operating system's reason.
    pub fn start(directory: &Path, set: &[String]) -> io::Result<System> {
        let settings = SETTINGS.into_iter().map(str::to_owned).chain(set.iter().cloned()).collect::<Vec<_>>();
        std::fs::create_dir_all(directory.parent().unwrap_or(directory))?;
        let _ = std::fs::remove_file(log_of(directory));
        let up = up(directory, &settings)?;
        let latches = Latches::open(directory)?;
        Ok(System { directory: directory.to_owned(), settings, up, latches, outcomes: channel() })
    }

    /// The process that is the service.
    pub fn process(&self, service: Service) -> Option<Identity> {
        place::holder(&self.directory.join(place::service_lock(service.name())))
    }

    /// Whether all services and the supervisor run, as the supervisor says.
    pub fn is_well(&self) -> bool {
        matches!(self.ask(&Request::Status), Ok(Answer::Status { services })
            if services.iter().all(|service| service.state.word() == "running"))
    }

    /// Whether the supervisor has ended by itself.
    pub fn has_ended(&mut self) -> bool {
        !matches!(self.up.try_wait(), Ok(None))
    }

    /// The supervisor's process.
    pub fn supervisor(&self) -> u32 {
        self.up.id()
    }

    /// Does it; `false` where there is nobody to do it to.
    ///
    /// # Errors
    /// The operating system's reason, where a new supervisor cannot be started.
    pub fn inflict(&mut self, fault: Fault) -> io::Result<bool> {
        let signal = |service, signal| {
            let process = self.process(service).and_then(|identity| Process::adopt(identity).ok());
            process.is_some_and(|process| process.signal(signal))
        };
        Ok(match fault {
            Fault::Kill(service) => signal(service, Signal::KILL),
            Fault::Stop(service) => signal(service, Signal::STOP),
            Fault::Restart(service) => {
                self.restart(service);
                true
            }
            Fault::KillSupervisor => {
                self.up.kill()?;
                self.up.wait()?;
                self.up = up(&self.directory, &self.settings)?;
                true
            }
            Fault::EmergencyStop => self.latches.latch(Latch::Emergency).is_ok(),
            Fault::Lie(_) => true,
            Fault::Camera(fault) => {
                let word =
                    CameraFault::ALL.into_iter().find(|(_, one)| *one == fault).map_or("", |(word, _)| word);
                std::fs::write(self.directory.join(place::CAMERA_FAULT), word)?;
                true
            }
        })
    }

    /// The camera is well again.
    pub fn heal(&self) {
        let _ = std::fs::remove_file(self.directory.join(place::CAMERA_FAULT));
    }

    fn restart(&self, service: Service) {
        let (socket, outcomes) = (self.directory.join(place::CONTROL), self.outcomes.0.clone());
        let begin = monotonic_ns();
        std::thread::spawn(move || {
            let request = Request::Restart { service: service.name().to_owned(), program: None };
            let refused = match ask(&socket, &request) {
                Ok(Answer::Refused { why }) => Some(why),
                Ok(_) => None,
                Err(error) => Some(error.to_string()),
            };
            let _ = outcomes.send(Outcome { service, times_ns: (begin, monotonic_ns()), refused });
        });
    }

    /// A planned restart that is over.
    pub fn outcome(&self) -> Option<Outcome> {
        self.outcomes.1.try_recv().ok()
    }

    /// An operator's reset.
    pub fn reset(&self) {
        let _ = self.latches.wish(Wish::Reset);
    }

    /// Ends it.
    pub fn end(mut self) {
        let _ = self.ask(&Request::Down);
        if self.up.wait().is_err() {
            let _ = self.up.kill();
        }
    }

    /// What the supervisors have said.
    pub fn log(&self) -> String {
        std::fs::read_to_string(log_of(&self.directory)).unwrap_or_default()
    }

    fn ask(&self, request: &Request) -> io::Result<Answer> {
        ask(&self.directory.join(place::CONTROL), request)
    }
}

/// Where the supervisors' log goes: not into the directory that they sweep.
fn log_of(directory: &Path) -> PathBuf {
    directory.with_extension("log")
}

fn up(directory: &Path, settings: &[String]) -> io::Result<Child> {
    let log = File::options().create(true).append(true).open(log_of(directory))?;
    let settings = settings.iter().flat_map(|setting| ["--set", setting]);
    Command::new(std::env::current_exe()?)
        .args(["up", "--run-dir"])
        .arg(directory)
        .args(settings)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(log)
        .spawn()
}

/// What is left of a system that has ended: shared memory and files of the transport.
pub fn leftovers(directory: &Path) -> usize {
    let Ok(instance) = Instance::at(directory) else { return 0 };
    let shared = instance.shared_memory_objects().len();
    shared + usize::from(directory.join("iox").exists())
}

/// Somebody who sends set-points that are none.
pub struct Liar {
    set_points: Publisher<SetPoints>,
}

impl Liar {
    /// Joins the bus, for one lie.
    pub fn join(bus: &Bus) -> Option<Liar> {
        bus.publisher(SetPoints).ok().map(|set_points| Liar { set_points })
    }

    /// Tells a lie about the newest frame.
    pub fn tell(&self, lie: Lie, newest: &Stamp) {
        let mut stamp = newest.extended(Service::Learner, Stage::Learn, monotonic_ns(), monotonic_ns());
        let mut point = SetPoint { follow: 1, phase: 2, position: [0.0, 0.5], ..SetPoint::default() };
        match lie {
            Lie::Garbage => point.position[0] = f64::NAN,
            Lie::Wrong => point.position = [1e6, -1e6],
            Lie::OldEpoch => stamp.epoch = stamp.epoch.saturating_sub(1),
            Lie::FromTheFuture => stamp.exposure_ns = monotonic_ns() + 60_000_000_000,
        }
        let _ = self.set_points.publish(&stamp, &point);
    }
}
