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

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use pursuit_bus::{Bus, FramePublisher, FrameSubscriber, Instance};
    use pursuit_messages::{ImageShape, Stamp};
    use std::path::PathBuf;

    /// A bus of its own with a writer and a reader of frames.
    struct Rig {
        directory: PathBuf,
        instance: Instance,
        frames: Option<(FramePublisher, FrameSubscriber)>,
    }

    impl Rig {
        fn new(name: &str) -> Rig {
            let directory = PathBuf::from(format!("/tmp/pv{}{name}", std::process::id()));
            let instance = Instance::at(&directory).unwrap();
            let bus = Bus::join(&instance, "test").unwrap();
            let frames = Some((bus.frame_publisher(64 * 64).unwrap(), bus.frame_subscriber().unwrap()));
            Rig { directory, instance, frames }
        }

        fn frame(&self, epoch: u64, number: u64) -> FrameMessage {
            let (writer, reader) = self.frames.as_ref().unwrap();
            let loan = writer.loan(64 * 64).unwrap();
            loan.send(&Stamp::new(epoch, number, number * 40, ImageShape::grey(64, 64))).unwrap();
            reader.receive().unwrap().unwrap()
        }
    }

    impl Drop for Rig {
        fn drop(&mut self) {
            self.frames = None;
            self.instance.wipe();
            let _ = std::fs::remove_dir_all(&self.directory);
        }
    }

    /// Older, newer, interval, continues.
    fn seen(pairs: &mut Pairs) -> (Option<u64>, u64, u32, bool) {
        let pair = pairs.pair().unwrap();
        let number = |frame: &FrameMessage| frame.stamp().frame;
        (pair.older.map(number), number(pair.newer), pair.interval, pair.continues)
    }

    #[test]
    fn frames_in_a_row_are_pairs_that_continue() {
        let rig = Rig::new("a");
        let mut pairs = Pairs::default();
        pairs.take(rig.frame(1, 0));
        assert_eq!(seen(&mut pairs), (None, 0, 0, false));
        pairs.take(rig.frame(1, 1));
        assert_eq!(seen(&mut pairs), (Some(0), 1, 1, true));
        pairs.take(rig.frame(1, 2));
        assert_eq!(seen(&mut pairs), (Some(1), 2, 1, true));
    }

    #[test]
    fn a_frame_that_comes_again_is_the_same_pair() {
        let rig = Rig::new("b");
        let mut pairs = Pairs::default();
        pairs.take(rig.frame(1, 4));
        pairs.take(rig.frame(1, 5));
        seen(&mut pairs);
        pairs.take(rig.frame(1, 5));
        assert_eq!(seen(&mut pairs), (Some(4), 5, 1, false));
    }

    #[test]
    fn a_restarted_camera_shows_its_last_two_frames_again() {
        let rig = Rig::new("c");
        let mut pairs = Pairs::default();
        pairs.take(rig.frame(1, 7));
        pairs.take(rig.frame(1, 8));
        seen(&mut pairs);
        pairs.take(rig.frame(1, 7));
        assert_eq!(seen(&mut pairs), (Some(7), 8, 1, false));
        pairs.take(rig.frame(1, 8));
        pairs.take(rig.frame(1, 9));
        assert_eq!(seen(&mut pairs), (Some(8), 9, 1, true), "8 is what the engine saw last");
    }

    #[test]
    fn a_new_epoch_and_a_long_gap_are_no_pair() {
        let rig = Rig::new("d");
        let mut pairs = Pairs::default();
        pairs.take(rig.frame(1, 7));
        pairs.take(rig.frame(2, 8));
        assert_eq!(seen(&mut pairs), (None, 8, 0, false));
        pairs.take(rig.frame(2, 10));
        assert_eq!(seen(&mut pairs), (Some(8), 10, 2, true));
        pairs.take(rig.frame(2, 20));
        assert_eq!(seen(&mut pairs), (None, 20, 0, false));
    }
}
