//! What the arm driver says of its safety chain: its state, and what brought it there.

use iceoryx2::prelude::ZeroCopySend;

/// Declares an enum of numbered, named things once: number, word, sentence.
macro_rules! numbered {
    (
        $(#[$doc:meta])* $name:ident {
            $($(#[$item_doc:meta])* $item:ident = $number:literal, $word:literal, $text:literal;)+
        }
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[repr(u32)]
        pub enum $name {
            $($(#[$item_doc])* #[doc = $text] $item = $number,)+
        }

        impl $name {
            /// All of them, in the order of their numbers.
            pub const ALL: &'static [$name] = &[$($name::$item,)+];

            /// The one with that number, if there is one.
            pub fn from_number(number: u32) -> Option<$name> {
                $name::ALL.iter().copied().find(|item| *item as u32 == number)
            }

            /// The word for it, as in status and diagram.
            pub fn word(self) -> &'static str {
                match self { $($name::$item => $word,)+ }
            }

            /// What it means, for people.
            pub fn text(self) -> &'static str {
                match self { $($name::$item => $text,)+ }
            }
        }
    };
}

numbered! {
    /// Whether and how the arm may move. The names are those of ros2_control and of robot makers.
    ArmState {
        Unconfigured = 0, "unconfigured", "the drives have not answered yet";
        Inactive = 1, "inactive", "the arm rests and follows nothing";
        Active = 2, "active", "set-points are followed";
        Holding = 3, "holding", "nothing to follow: the arm is at rest or comes to rest";
        ProtectiveStop = 4, "protective_stop", "stopped, until an operator's reset";
        EmergencyStop = 5, "emergency_stop", "stopped for emergency, until an operator's reset";
        Recovery = 6, "recovery", "a joint is outside its limits: nothing is commanded until it is inside";
        Fault = 7, "fault", "the drives are lost or off, until a reset";
    }
}

numbered! {
    /// What happens to the arm's state. The last one that changed it is the state's cause.
    ArmEvent {
        Started = 0, "started", "the driver has started";
        Configured = 1, "configured", "the drives answer";
        Activated = 2, "activated", "asked to follow, and set-points are there";
        ActivatedTooSoon = 3, "activated_too_soon", "asked to follow, but no set-points are there";
        Deactivated = 4, "deactivated", "asked to follow no more";
        SetPointsLost = 5, "set_points_lost", "no set-point that can be followed";
        HoldAsked = 6, "hold_asked", "the set-point says hold";
        SetPointsBack = 7, "set_points_back", "there is a set-point to follow";
        HoldExpired = 8, "hold_expired", "no set-points for too long";
        BadSetPoints = 9, "bad_set_points", "set-points in a row that no sane sender sends";
        FollowingError = 10, "following_error", "the joints are not where the drives were told to be";
        Outside = 11, "outside", "a joint is outside its limits";
        Inside = 12, "inside", "all joints are inside their limits";
        ProtectiveAsked = 13, "protective_asked", "a protective stop was asked for, or one was latched before";
        EmergencyAsked = 14, "emergency_asked", "an emergency stop was asked for, or one was latched before";
        EmergencyPressed = 15, "emergency_pressed", "the emergency button is pressed";
        DriveLost = 16, "drive_lost", "the drives do not answer, or are off";
        Reset = 17, "reset", "an operator's reset";
        ResetWhilePressed = 18, "reset_while_pressed", "a reset while the emergency button is pressed";
        ResetWhileMoving = 19, "reset_while_moving", "a reset before the arm is at rest";
    }
}

impl ArmState {
    /// Whether only an operator can end it.
    pub fn is_latched(self) -> bool {
        matches!(self, ArmState::ProtectiveStop | ArmState::EmergencyStop | ArmState::Fault)
    }
}

/// The arm driver's state (topic DRIVER_STATE): on every change, with every reading, and ten times a second.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ZeroCopySend)]
#[repr(C)]
#[type_name("pursuit/DriverState/1")]
pub struct DriverState {
    /// CLOCK_MONOTONIC when this was written, ns.
    pub time_ns: u64,
    /// CLOCK_MONOTONIC of the last change of state, ns.
    pub since_ns: u64,
    /// Operator's wishes (reset, activate) that this process has answered.
    pub answered: u64,
    /// Process id of the driver.
    pub pid: u32,
    /// [`ArmState`] as a number.
    pub state: u32,
    /// [`ArmEvent`] that led to it, as a number.
    pub cause: u32,
    /// The event that the last wish of an operator came to, as a number.
    pub answer: u32,
    /// 1 where the arm is at rest: nothing is commanded to move, and nothing moves.
    pub at_rest: u32,
    /// Refusal of the last set-point as a number, 0 for none.
    pub refusal: u32,
}

impl DriverState {
    /// The state, where the number is one.
    pub fn state(&self) -> Option<ArmState> {
        ArmState::from_number(self.state)
    }

    /// What led to it, where the number is one.
    pub fn cause(&self) -> Option<ArmEvent> {
        ArmEvent::from_number(self.cause)
    }
}
