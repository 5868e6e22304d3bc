//! The nemesis: which fault comes when. Pure: one seed, one plan.

use pursuit_acquisition::fault::Fault as CameraFault;
use pursuit_messages::Service;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::fmt;
use std::time::Duration;

/// Time between two faults, s.
const PAUSE_S: std::ops::Range<f64> = 0.5..4.0;

/// What a set-point can lie about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lie {
    /// Not a number.
    Garbage,
    /// Far away from anything that an arm has.
    Wrong,
    /// Of a camera that is gone.
    OldEpoch,
    /// Of a frame that has not been taken.
    FromTheFuture,
}

/// A kind of fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Kind {
    /// SIGKILL for a service.
    Kill,
    /// SIGSTOP for a service.
    Stop,
    /// A planned restart of a service.
    Restart,
    /// SIGKILL for the supervisor.
    Supervisor,
    /// An emergency stop.
    Emergency,
    /// A set-point that is none.
    Lie,
    /// A camera that fails for a while.
    Camera,
}

/// One fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// SIGKILL.
    Kill(Service),
    /// SIGSTOP.
    Stop(Service),
    /// A planned restart.
    Restart(Service),
    /// SIGKILL for the supervisor; another one comes at once.
    KillSupervisor,
    /// Somebody stops the arm, and resets it later.
    EmergencyStop,
    /// Somebody sends a set-point that is none.
    Lie(Lie),
    /// The camera has this for a while.
    Camera(CameraFault),
}

impl Fault {
    /// Its kind.
    pub fn kind(self) -> Kind {
        match self {
            Fault::Kill(_) => Kind::Kill,
            Fault::Stop(_) => Kind::Stop,
            Fault::Restart(_) => Kind::Restart,
            Fault::KillSupervisor => Kind::Supervisor,
            Fault::EmergencyStop => Kind::Emergency,
            Fault::Lie(_) => Kind::Lie,
            Fault::Camera(_) => Kind::Camera,
        }
    }

    /// The service that it is about, if it is about one.
    pub fn service(self) -> Option<Service> {
        match self {
            Fault::Kill(service) | Fault::Stop(service) | Fault::Restart(service) => Some(service),
            Fault::KillSupervisor | Fault::EmergencyStop | Fault::Lie(_) | Fault::Camera(_) => None,
        }
    }

    /// Whether the supervisor counts it as a death of that service.
    pub fn is_a_death(self) -> bool {
        matches!(self, Fault::Kill(_) | Fault::Stop(_))
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Fault::Kill(service) => write!(f, "SIGKILL for {}", service.name()),
            Fault::Stop(service) => write!(f, "SIGSTOP for {}", service.name()),
            Fault::Restart(service) => write!(f, "planned restart of {}", service.name()),
            Fault::KillSupervisor => write!(f, "SIGKILL for the supervisor"),
            Fault::EmergencyStop => write!(f, "emergency stop"),
            Fault::Camera(fault) => write!(f, "a camera that is {}", format!("{fault:?}").to_lowercase()),
            Fault::Lie(lie) => write!(f, "a set-point that is {lie:?}"),
        }
    }
}

/// Where faults come from.
pub struct Nemesis {
    random: ChaCha8Rng,
    kinds: Vec<Kind>,
}

impl Nemesis {
    /// The one with that seed; of `kinds` only, or of all where that is empty.
    pub fn new(seed: u64, kinds: &[Kind]) -> Nemesis {
        Nemesis { random: ChaCha8Rng::seed_from_u64(seed), kinds: kinds.to_vec() }
    }

    /// The next fault, and how long after the one before.
    pub fn next(&mut self) -> (Duration, Fault) {
        loop {
            let (pause, fault) = self.any();
            if self.kinds.is_empty() || self.kinds.contains(&fault.kind()) {
                return (pause, fault);
            }
        }
    }

    fn any(&mut self) -> (Duration, Fault) {
        let pause = Duration::from_secs_f64(self.random.random_range(PAUSE_S));
        let of_the_loop = Service::ALL.map(|service| service.is_in_the_loop().then_some(service));
        let of_the_loop: Vec<Service> = of_the_loop.into_iter().flatten().collect();
        let service = of_the_loop[self.random.random_range(0..of_the_loop.len())];
        let lies = [Lie::Garbage, Lie::Wrong, Lie::OldEpoch, Lie::FromTheFuture];
        let lie = lies[self.random.random_range(0..lies.len())];
        let (_, camera) = CameraFault::ALL[self.random.random_range(0..CameraFault::ALL.len())];
        let fault = match self.random.random_range(0..100) {
            0..46 => Fault::Kill(service),
            46..57 => Fault::Stop(service),
            57..70 => Fault::Restart(service),
            70..77 => Fault::KillSupervisor,
            77..83 => Fault::EmergencyStop,
            83..91 => Fault::Lie(lie),
            _ => Fault::Camera(camera),
        };
        (pause, fault)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_seed_is_one_plan_and_has_every_fault() {
        let plan = |seed| {
            let mut nemesis = Nemesis::new(seed, &[]);
            (0..400).map(|_| nemesis.next()).collect::<Vec<_>>()
        };
        assert_eq!(plan(3), plan(3));
        assert_ne!(plan(3), plan(4));
        let faults: Vec<Fault> = plan(3).into_iter().map(|(_, fault)| fault).collect();
        for service in Service::ALL.into_iter().filter(|service| service.is_in_the_loop()) {
            for fault in [Fault::Kill(service), Fault::Stop(service), Fault::Restart(service)] {
                assert!(faults.contains(&fault), "{fault}");
            }
        }
        let mut some = Nemesis::new(3, &[Kind::Lie, Kind::Stop]);
        assert!((0..50).all(|_| matches!(some.next().1.kind(), Kind::Lie | Kind::Stop)));
        assert!(faults.contains(&Fault::KillSupervisor) && faults.contains(&Fault::EmergencyStop));
    }
}
