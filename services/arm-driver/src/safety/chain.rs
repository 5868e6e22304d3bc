//! What is watched from look to look, and what follows from it: the events of the state machine.
//!
//! One look for each turn of the driver's loop. The chain is pure: time, readings and wishes come in, a
//! verdict goes out.

use super::Machine;
use crate::arm::Reading;
use crate::step::Drives;
use pursuit_kinematics::{Arm, JOINTS};
use pursuit_messages::{ArmEvent, ArmState, Refusal, Stamp};
use pursuit_runtime::latch::{Latch, Wish};

/// Set-points that no sane sender sends, in a row, until the arm stops.
const BAD_IN_A_ROW: u32 = 3;
/// Readings with too large a following error, in a row, until the arm stops.
const ERRORS_IN_A_ROW: u32 = 3;
/// Frames in a row with a good set-point that an operator's activation needs: a stream, not one that is left.
const STREAM: u32 = 3;
/// Without good set-points for so long in `holding`, only an activation moves the arm again, ns.
const HOLD_NS: u64 = 2_000_000_000;
/// Slower than this is at rest, rad/s: noise of a velocity reading.
const REST_RAD_PER_S: f64 = 0.01;

/// Who lets an arm move that is able to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activation {
    /// The first good set-point: for a simulated arm.
    Automatic,
    /// An operator, while set-points are coming.
    Operator,
}

/// What the chain goes by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// Who lets the arm move.
    pub activation: Activation,
    /// Largest distance between where a joint is and where its drive was told to be, rad.
    pub following_error_rad: f64,
}

/// What is seen in one turn of the loop.
#[derive(Clone, Copy, Debug)]
pub struct Look<'a> {
    /// Time on the loop's clock, ns.
    pub now_ns: u64,
    /// The newest reading of the drives, where there is one that is not too old.
    pub reading: Option<&'a Reading>,
    /// The latched stop, if any.
    pub latch: Option<Latch>,
    /// What an operator wants, once for each time that it is wanted.
    pub wish: Option<Wish>,
    /// Epoch and number of the frame behind the set-point that shall move the arm.
    pub frame: Option<(u64, u64)>,
    /// What the gates say of that set-point; `None` where there is nothing to answer in this turn.
    pub judged: Option<Result<(), Refusal>>,
}

/// What follows from a look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// Why the set-point must not move the arm, where it must not.
    pub refusal: Option<Refusal>,
    /// The latch that must be set, where the state needs one.
    pub latch: Option<Latch>,
    /// Whether all latches are to be taken away: a reset was done.
    pub released: bool,
    /// The event that an operator's wish came to.
    pub answer: Option<ArmEvent>,
    /// Whether the state changed.
    pub changed: bool,
    /// Whether nothing is commanded to move and nothing moves.
    pub at_rest: bool,
}

/// Why a wish was not granted, where it was not; for people.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refused(pub ArmEvent);

impl Refused {
    /// The refusal in an answer; `None` where the wish was granted.
    pub fn of(answer: ArmEvent) -> Option<Refused> {
        let granted = matches!(answer, ArmEvent::Reset | ArmEvent::Activated);
        (!granted).then_some(Refused(answer))
    }
}

/// The safety chain: the machine, and what it has to remember between two looks.
#[derive(Clone, Debug)]
pub struct Chain {
    rules: Rules,
    arm: Arm,
    machine: Machine,
    /// Epoch and number of the newest frame whose set-point was looked at.
    newest: Option<(u64, u64)>,
    /// Good set-points in a row, up to [`STREAM`].
    good: u32,
    /// The last one, ns on the loop's clock.
    good_ns: u64,
    /// Set-points in a row that no sane sender sends.
    bad: u32,
    /// Readings in a row with too large a following error.
    errors: u32,
    last_reading_ns: Option<u64>,
}

impl Chain {
    /// A chain for `arm` that has seen nothing yet.
    pub fn new(rules: Rules, arm: &Arm) -> Chain {
        Chain {
            rules,
            arm: *arm,
            machine: Machine::default(),
            newest: None,
            good: 0,
            good_ns: 0,
            bad: 0,
            errors: 0,
            last_reading_ns: None,
        }
    }

    /// State and cause.
    pub fn machine(&self) -> &Machine {
        &self.machine
    }

    /// Whether a set-point of that frame comes from the past: frames rise within an epoch. The same frame may
    /// come again.
    pub fn is_backwards(&self, stamp: &Stamp) -> bool {
        self.newest.is_some_and(|newest| (stamp.epoch, stamp.frame) < newest)
    }

    /// The driver ends: nothing is followed any more.
    pub fn end(&mut self) {
        self.machine.take(ArmEvent::Deactivated);
    }

    /// One turn of the loop; the stronger event comes first.
    pub fn look(&mut self, look: &Look<'_>) -> Verdict {
        let before = *self.machine();
        let at_rest = look.reading.is_some_and(|reading| is_at_rest(&reading.drives));
        self.watch_drives(look);
        self.watch_set_points(look);
        let mut verdict = Verdict {
            refusal: None,
            latch: None,
            released: false,
            answer: None,
            changed: false,
            // Without a reading the drives have stopped by themselves, or there is no arm.
            at_rest: at_rest || look.reading.is_none(),
        };
        if let Some(wish) = look.wish {
            let answer = self.answer(wish, look, verdict.at_rest);
            verdict.released = answer == ArmEvent::Reset;
            verdict.answer = Some(answer);
        }
        if !verdict.released {
            self.obey(look.latch);
        }
        self.go_by(look);
        verdict.latch = match self.machine.state() {
            ArmState::EmergencyStop => Some(Latch::Emergency),
            ArmState::ProtectiveStop => Some(Latch::Protective),
            _ => None,
        }
        .filter(|latch| look.latch < Some(*latch));
        verdict.refusal = self.refusal(look);
        verdict.changed = before != self.machine;
        verdict
    }

    fn obey(&mut self, latch: Option<Latch>) {
        let event = match latch {
            Some(Latch::Emergency) => ArmEvent::EmergencyAsked,
            Some(Latch::Protective) => ArmEvent::ProtectiveAsked,
            None => return,
        };
        self.machine.take(event);
    }

    fn watch_drives(&mut self, look: &Look<'_>) {
        let Some(reading) = look.reading else {
            self.errors = 0;
            self.machine.take(ArmEvent::DriveLost);
            return;
        };
        if !reading.enabled {
            self.machine.take(ArmEvent::DriveLost);
        } else if self.machine.state() != ArmState::Fault {
            self.machine.take(ArmEvent::Configured);
        } else if self.rules.activation == Activation::Automatic && look.latch.is_none() {
            // A simulated arm that is back is reset by nobody.
            self.machine.take(ArmEvent::Reset);
            self.machine.take(ArmEvent::Configured);
        }
        if reading.pressed {
            self.machine.take(ArmEvent::EmergencyPressed);
        }
        let inside = self.arm.within_limits(&reading.drives.position);
        self.machine.take(if inside { ArmEvent::Inside } else { ArmEvent::Outside });
        // A reading that was seen before says nothing new.
        if self.last_reading_ns.replace(reading.time_ns) == Some(reading.time_ns) {
            return;
        }
        let pairs = reading.drives.position.iter().zip(&reading.demanded);
        // Written so that not a number is an error.
        let follows = pairs.into_iter().all(|(is, told)| (is - told).abs() <= self.rules.following_error_rad);
        self.errors = if follows { 0 } else { (self.errors + 1).min(ERRORS_IN_A_ROW) };
        if self.errors >= ERRORS_IN_A_ROW {
            self.machine.take(ArmEvent::FollowingError);
        }
    }

    fn watch_set_points(&mut self, look: &Look<'_>) {
        // The same set-point moves the arm for many cycles and counts once.
        let is_new = look.frame.is_some() && self.newest < look.frame;
        self.newest = self.newest.max(look.frame);
        match look.judged {
            None => {}
            Some(Ok(()) | Err(Refusal::Hold)) => {
                self.bad = 0;
                self.good += u32::from(is_new && self.good < STREAM);
                self.good_ns = look.now_ns;
            }
            Some(Err(refusal)) => {
                self.good = 0;
                self.bad += u32::from(is_new && refusal.is_bad_data() && self.bad < BAD_IN_A_ROW);
            }
        }
        if self.bad >= BAD_IN_A_ROW {
            self.machine.take(ArmEvent::BadSetPoints);
        }
    }

    fn answer(&mut self, wish: Wish, look: &Look<'_>, at_rest: bool) -> ArmEvent {
        let pressed = look.reading.is_some_and(|reading| reading.pressed);
        let event = match wish {
            Wish::Reset if pressed => ArmEvent::ResetWhilePressed,
            Wish::Reset if !at_rest => ArmEvent::ResetWhileMoving,
            Wish::Reset => {
                (self.bad, self.errors, self.good) = (0, 0, 0);
                ArmEvent::Reset
            }
            Wish::Activate if self.good < STREAM => ArmEvent::ActivatedTooSoon,
            Wish::Activate => ArmEvent::Activated,
        };
        self.machine.take(event);
        event
    }

    /// What the set-points mean for a state that may move.
    fn go_by(&mut self, look: &Look<'_>) {
        let can_move = look.reading.is_some_and(|reading| reading.enabled);
        let Some(judged) = look.judged else { return };
        let streams = matches!(judged, Ok(()) | Err(Refusal::Hold));
        if self.rules.activation == Activation::Automatic && streams && can_move {
            self.machine.take(ArmEvent::Activated);
        }
        match judged {
            Ok(()) => self.machine.take(ArmEvent::SetPointsBack),
            Err(Refusal::Hold) => self.machine.take(ArmEvent::HoldAsked),
            Err(_) if look.now_ns.saturating_sub(self.good_ns) >= HOLD_NS => {
                self.machine.take(ArmEvent::SetPointsLost);
                self.machine.take(ArmEvent::HoldExpired)
            }
            Err(_) => self.machine.take(ArmEvent::SetPointsLost),
        };
    }

    /// A set-point's own fault before the state's: it says more.
    fn refusal(&self, look: &Look<'_>) -> Option<Refusal> {
        let state = match self.machine.state() {
            ArmState::Active | ArmState::Holding => None,
            ArmState::Unconfigured | ArmState::Inactive => Some(Refusal::Inactive),
            _ => Some(Refusal::Stopped),
        };
        match state {
            Some(Refusal::Stopped) => state,
            _ => look.judged.and_then(Result::err).or(state),
        }
    }
}

/// Nothing moves, and nothing that is issued would move.
fn is_at_rest(drives: &Drives) -> bool {
    let slow = |velocities: &[f64; JOINTS]| velocities.iter().all(|v| v.abs() < REST_RAD_PER_S);
    slow(&drives.velocity) && drives.issued_velocity.iter().all(|velocity| *velocity == 0.0)
}
