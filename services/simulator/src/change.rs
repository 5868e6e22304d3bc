//! Section `[change]`: what happens to the cell in the middle of a run that nobody tells the others of.

use pursuit_config::Checker;
use pursuit_kinematics::{Camera, Coupling, Rig};

/// Another camera or another arm, from some instant on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// When it comes.
    pub when: When,
    /// How far the camera is turned in the hand, on top of what it was, rad.
    pub mount_rad: f64,
    /// Factor on the focal length: another lens.
    pub focal_factor: f64,
    /// Factor on the forearm's length (d4). Driver and coupling go on with the nominal one.
    pub forearm_factor: f64,
}

/// When a change comes. It holds from the next exposure on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum When {
    /// Never.
    Never,
    /// Before the first exposure.
    Start,
    /// After so many training moves, when the last of them has been evaluated; the arm is at rest.
    Moves(u32),
    /// So long after the first frame of tracking, ns.
    Tracking(u64),
}

impl Change {
    /// Reads the section; faults go to the checker.
    pub fn read(checker: &Checker<'_>) -> Change {
        #[derive(Clone, Copy, PartialEq)]
        enum Word {
            Never,
            Start,
            Move,
            Tracking,
        }
        let section = checker.section("change");
        let words = [
            ("never", Word::Never),
            ("start", Word::Start),
            ("move", Word::Move),
            ("tracking", Word::Tracking),
        ];
        let word = section.choice_or("when", &words, Word::Never);
        let after = section.float_or("after", 0.0..=1e6, 0.0);
        if word == Word::Move && after.fract() != 0.0 {
            section.fault("after", "must be a whole number of training moves with when = \"move\"");
        }
        Change {
            when: match word {
                Word::Never => When::Never,
                Word::Start => When::Start,
                Word::Move => When::Moves(after as u32),
                Word::Tracking => When::Tracking((after * 1e9).round() as u64),
            },
            mount_rad: section.float_or("mount_deg", -180.0..=180.0, 0.0).to_radians(),
            focal_factor: section.float_or("focal_factor", 0.1..=10.0, 1.0),
            forearm_factor: section.float_or("forearm_factor", 0.5..=1.5, 1.0),
        }
    }

    /// The cell's arm and camera after the change.
    pub fn rig(&self, coupling: &Coupling, camera: &Camera) -> Rig {
        let changed = Camera {
            focal_px: camera.focal_px * self.focal_factor,
            mount_rad: camera.mount_rad + self.mount_rad,
            ..*camera
        };
        Rig::new(coupling, &coupling.arm().with_forearm(self.forearm_factor), &changed)
    }
}
