//! Which two frames are voted on: the newest and one a baseline before, also when one is asked for again.

use pursuit_bus::FrameMessage;
use pursuit_messages::topics::MAX_BASELINE;
use std::collections::VecDeque;

/// Frames further apart than so many baselines are no pair: nothing is known of what happened in between.
const MAX_BASELINES: u64 = 4;
/// Frames that are held: the newest, and those up to a baseline before.
const HELD: usize = MAX_BASELINE as usize + 1;

/// Which frame, for all time: epoch and number.
type Identity = (u64, u64);

fn identity(frame: &FrameMessage) -> Identity {
    (frame.stamp().epoch, frame.stamp().frame)
}

/// The last frames of an epoch, held in shared memory.
pub struct Pairs {
    baseline: u64,
    /// Rising numbers.
    frames: VecDeque<FrameMessage>,
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
    /// Of frames `baseline` apart, 1 to [`MAX_BASELINE`], where there are such.
    pub fn new(baseline: u64) -> Pairs {
        Pairs { baseline, frames: VecDeque::with_capacity(HELD), voted: None }
    }

    /// Takes a frame. One that is there already (asked for again after a restart elsewhere) is replaced
    /// by its twin, so that the same pair gives the same answer. A restarted camera shows its last frames
    /// again: they take their place among the others. A new epoch begins anew.
    pub fn take(&mut self, frame: FrameMessage) {
        let (epoch, number) = identity(&frame);
        if self.frames.back().is_some_and(|newest| newest.stamp().epoch != epoch) {
            self.frames.clear();
        }
        let place = self.frames.partition_point(|held| held.stamp().frame < number);
        match self.frames.get_mut(place) {
            Some(held) if held.stamp().frame == number => *held = frame,
            _ => self.frames.insert(place, frame),
        }
        // Of the frames that are a baseline or more before the newest, one is enough.
        let newest = self.frames.back().map_or(number, |newest| newest.stamp().frame);
        while self.frames.get(1).is_some_and(|second| second.stamp().frame + self.baseline <= newest) {
            self.frames.pop_front();
        }
    }

    /// Whether all frames of the newest one's pair are there, counting from frame 0. Only then does a frame
    /// that comes again get the same answer.
    pub fn is_complete(&self) -> bool {
        let number = |frame: Option<&FrameMessage>| frame.map_or(0, |frame| frame.stamp().frame);
        let (oldest, newest) = (number(self.frames.front()), number(self.frames.back()));
        oldest == newest.saturating_sub(self.baseline)
    }

    /// The pair to vote on now; the caller votes on it. Its older frame is the newest of those that are at
    /// least a baseline before, or, while there is none, the oldest.
    pub fn pair(&mut self) -> Option<Pair<'_>> {
        let newer = self.frames.back()?;
        let number = newer.stamp().frame;
        // Of two, `take` keeps no more than one that is a baseline or more before.
        let older = self.frames.front().filter(|older| {
            let apart = number - older.stamp().frame;
            (1..=MAX_BASELINES * self.baseline).contains(&apart)
        });
        let interval = older.map_or(0, |frame| (number - frame.stamp().frame) as u32);
        let continues = older.is_some_and(|frame| self.voted == Some(identity(frame)));
        self.voted = Some(identity(newer));
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
        let mut pairs = Pairs::new(1);
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
        let mut pairs = Pairs::new(1);
        pairs.take(rig.frame(1, 4));
        pairs.take(rig.frame(1, 5));
        seen(&mut pairs);
        pairs.take(rig.frame(1, 5));
        assert_eq!(seen(&mut pairs), (Some(4), 5, 1, false));
    }

    #[test]
    fn a_restarted_camera_shows_its_last_two_frames_again() {
        let rig = Rig::new("c");
        let mut pairs = Pairs::new(1);
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
    fn pairs_are_a_baseline_apart_as_soon_as_that_can_be() {
        let rig = Rig::new("e");
        let mut pairs = Pairs::new(3);
        let mut seen_after = |number| {
            pairs.take(rig.frame(1, number));
            let complete = pairs.is_complete();
            assert_eq!(complete, number < 8, "frame {number}: 5 and 7 were passed over");
            seen(&mut pairs)
        };
        let firsts: Vec<_> = (0..5).map(&mut seen_after).collect();
        let expected = [None, Some(0), Some(0), Some(0), Some(1)];
        assert_eq!(firsts.iter().map(|pair| pair.0).collect::<Vec<_>>(), expected);
        assert_eq!(firsts.iter().map(|pair| pair.2).collect::<Vec<_>>(), [0, 1, 2, 3, 3]);
        // The older one is never nearer than a baseline where there is another.
        assert_eq!(seen_after(6), (Some(3), 6, 3, false));
        assert_eq!(seen_after(8), (Some(4), 8, 4, false));
    }

    #[test]
    fn who_comes_late_has_the_same_pair_when_the_last_frames_are_shown_again() {
        let rig = Rig::new("f");
        let (mut early, mut late) = (Pairs::new(3), Pairs::new(3));
        (0..=20).for_each(|number| early.take(rig.frame(1, number)));
        (17..=20).for_each(|number| late.take(rig.frame(1, number)));
        assert_eq!(seen(&mut early), seen(&mut late));
        // ... and shown again to the one that has them.
        (17..=20).for_each(|number| early.take(rig.frame(1, number)));
        assert_eq!(seen(&mut early), (Some(17), 20, 3, false));
    }

    #[test]
    fn a_new_epoch_and_a_long_gap_are_no_pair() {
        let rig = Rig::new("d");
        let mut pairs = Pairs::new(1);
        pairs.take(rig.frame(1, 7));
        pairs.take(rig.frame(2, 8));
        assert_eq!(seen(&mut pairs), (None, 8, 0, false));
        pairs.take(rig.frame(2, 10));
        assert_eq!(seen(&mut pairs), (Some(8), 10, 2, true));
        pairs.take(rig.frame(2, 20));
        assert_eq!(seen(&mut pairs), (None, 20, 0, false));
    }
}
