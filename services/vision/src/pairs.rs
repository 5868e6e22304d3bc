//! Which two frames are voted on: the newest and the one before, also when one is asked for again.

use pursuit_bus::FrameMessage;

/// Frames further apart than this are no pair: nothing is known of what happened in between.
const MAX_INTERVAL: u64 = 4;

/// Which frame, for all time: epoch and number.
type Identity = (u64, u64);

fn identity(frame: &FrameMessage) -> Identity {
    (frame.stamp().epoch, frame.stamp().frame)
}

/// The newest frame and the one before, held in shared memory.
#[derive(Default)]
pub struct Pairs {
    older: Option<FrameMessage>,
    newer: Option<FrameMessage>,
    /// What the engine saw last as the newest frame.
    voted: Option<Identity>,
}

/// A pair to vote on.
pub struct Pair<'a> {
    /// The frame before, where there is one near enough.
    pub older: Option<&'a FrameMessage>,
    /// The newest frame.
    pub newer: &'a FrameMessage,
    /// Frames from one to the other; 0 where there is no older one.
    pub interval: u32,
    /// Whether `older` is what the engine saw last as its newest frame.
    pub continues: bool,
}

impl Pairs {
    /// Takes a frame. One that is there already (asked for again after a restart elsewhere) is replaced
    /// by its twin, so that the same pair gives the same answer; a new epoch begins anew.
    pub fn take(&mut self, frame: FrameMessage) {
        let (epoch, number) = identity(&frame);
        match self.newer.as_ref().map(identity) {
            Some(newest) if newest == (epoch, number) => self.newer = Some(frame),
            Some(newest) if newest.0 == epoch && newest.1 < number => self.older = self.newer.replace(frame),
            // A restarted camera shows its last two frames again, the older one first.
            Some(newest) if newest.0 == epoch && newest.1 == number + 1 => self.older = Some(frame),
            Some(newest) if newest.0 == epoch => {}
            _ => {
                self.older = None;
                self.newer = Some(frame);
            }
        }
    }

    /// The pair to vote on now; the caller votes on it.
    pub fn pair(&mut self) -> Option<Pair<'_>> {
        let newer = self.newer.as_ref()?;
        let (epoch, number) = identity(newer);
        let older = self
            .older
            .as_ref()
            .filter(|frame| frame.stamp().epoch == epoch && number - frame.stamp().frame <= MAX_INTERVAL);
        let interval = older.map_or(0, |frame| (number - frame.stamp().frame) as u32);
        let continues = older.is_some_and(|frame| self.voted == Some(identity(frame)));
        self.voted = Some((epoch, number));
        Some(Pair { older, newer, interval, continues })
    }
}
