use super::keeper::{Keeper, Vault};
use super::*;
use std::time::{Duration, Instant};

struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Scratch {
        let path = std::env::temp_dir().join(format!("pursuit-checkpoint-{name}-{}", std::process::id()));
        let _ = std::fs::remove_file(&path);
        Scratch(path)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
        let _ = std::fs::remove_file(refused_name(&self.0));
    }
}

fn save(checkpoint: &mut Checkpoint, state: &[u8]) {
    checkpoint.save(|buffer| buffer.extend_from_slice(state)).unwrap();
}

fn reasons(path: &Path, schema: u32, capacity: usize) -> Vec<Refusal> {
    let restored = read(path, schema, capacity).unwrap();
    restored.refused.into_iter().map(|(_, refusal)| refusal).collect()
}

#[test]
fn the_last_saved_state_comes_back() {
    let file = Scratch::new("last");
    let (mut checkpoint, before) = Checkpoint::open(&file.0, 1, 100).unwrap();
    assert!(before.is_none());
    for n in 0..5u8 {
        save(&mut checkpoint, &[n; 20]);
    }
    let (_, state) = Checkpoint::open(&file.0, 1, 100).unwrap();
    assert_eq!(state.unwrap(), [4; 20]);
}

#[test]
fn after_a_refused_slot_the_good_one_is_not_the_next_to_be_written() {
    let file = Scratch::new("keep");
    let (mut checkpoint, _) = Checkpoint::open(&file.0, 1, 100).unwrap();
    save(&mut checkpoint, b"one");
    save(&mut checkpoint, b"two");
    let mut bytes = std::fs::read(&file.0).unwrap();
    bytes[slot::bytes_for(100) + HEADER] ^= 1;
    std::fs::write(&file.0, &bytes).unwrap();
    assert_eq!(reasons(&file.0, 1, 100), [Refusal::State]);
    let (mut checkpoint, state) = Checkpoint::open(&file.0, 1, 100).unwrap();
    assert_eq!(state.unwrap(), b"one");
    save(&mut checkpoint, b"three");
    let bytes = std::fs::read(&file.0).unwrap();
    assert_eq!(&bytes[HEADER..HEADER + 3], b"one", "the good one stays until the next save is whole");
    assert_eq!(Checkpoint::open(&file.0, 1, 100).unwrap().1.unwrap(), b"three");
}

/// A state as large as the learner's, cut and flipped at every 64th byte of the file and at all of a header.
#[test]
fn a_file_cut_or_flipped_anywhere_gives_the_last_or_the_one_before_never_half() {
    const CAPACITY: usize = 10_000;
    let file = Scratch::new("torn");
    let (mut checkpoint, _) = Checkpoint::open(&file.0, 1, CAPACITY).unwrap();
    for n in 1..=4u8 {
        save(&mut checkpoint, &[n; 9_000]);
    }
    let whole = std::fs::read(&file.0).unwrap();
    let places = (0..HEADER).chain((0..whole.len()).step_by(64));
    for at in places {
        for flipped in [true, false] {
            let mut bytes = whole.clone();
            if flipped {
                bytes[at] ^= 0x41;
            } else {
                bytes.truncate(at);
            }
            let (restored, next_slot) = newest(&bytes, 1, CAPACITY);
            let in_first = at < slot::bytes_for(CAPACITY);
            match restored.state {
                Some(state) => {
                    assert!(state == [4; 9_000] || state == [3; 9_000], "half a state at byte {at}");
                    let held = if state == [4; 9_000] { 1 } else { 0 };
                    assert_eq!(next_slot, 1 - held, "the good slot would be overwritten, byte {at}");
                }
                None => assert!(!flipped && in_first, "one damaged byte cost both slots (byte {at})"),
            }
        }
    }
}

#[test]
fn another_schema_is_refused_by_name_and_set_aside_not_overwritten() {
    let file = Scratch::new("schema");
    let (mut checkpoint, _) = Checkpoint::open(&file.0, 1, 100).unwrap();
    save(&mut checkpoint, b"old");
    let before = std::fs::read(&file.0).unwrap();
    assert_eq!(reasons(&file.0, 2, 100), [Refusal::Schema { found: 1, wanted: 2 }]);
    assert!(Checkpoint::open(&file.0, 2, 100).unwrap().1.is_none());
    assert_eq!(std::fs::read(refused_name(&file.0)).unwrap(), before);
}

#[test]
fn what_is_not_a_checkpoint_is_refused_by_name() {
    let file = Scratch::new("foreign");
    std::fs::write(&file.0, "weights = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]").unwrap();
    assert_eq!(reasons(&file.0, 1, 100), [Refusal::Foreign]);
    std::fs::write(&file.0, "PURS").unwrap();
    assert_eq!(reasons(&file.0, 1, 100), [Refusal::Truncated { found: 4, expected: HEADER }]);
    std::fs::write(&file.0, "").unwrap();
    assert_eq!(reasons(&file.0, 1, 100), []);
}

#[test]
fn a_state_too_large_is_refused_and_the_old_one_kept() {
    let file = Scratch::new("large");
    let (mut checkpoint, _) = Checkpoint::open(&file.0, 1, 10).unwrap();
    save(&mut checkpoint, b"small");
    assert!(checkpoint.save(|buffer| buffer.extend_from_slice(&[0; 5000])).is_err());
    assert_eq!(Checkpoint::open(&file.0, 1, 10).unwrap().1.unwrap(), b"small");
}

#[test]
fn the_keeper_puts_on_the_disk_what_is_newest_and_the_rest_at_its_end() {
    let (live, kept) = (Scratch::new("live"), Scratch::new("kept"));
    let (mut checkpoint, _) = Checkpoint::open(&live.0, 1, 100).unwrap();
    let (vault, before) = Vault::open(&kept.0, 1, 100).unwrap();
    assert!(before.state.is_none());
    let keeper = Keeper::start(&checkpoint, vault, Duration::from_millis(1), |_| {}).unwrap();
    let limit = Instant::now() + Duration::from_secs(60);
    let mut n = 0;
    while keeper.stored() < 20 {
        assert!(Instant::now() < limit, "nothing is stored");
        n += 1;
        save(&mut checkpoint, &[n as u8; 50]);
        let stored = read(&kept.0, 1, 100).unwrap();
        assert!(stored.refused.len() < 2, "one slot is whole while the other is written");
        if let Some(state) = stored.state {
            assert_eq!(state, [stored.sequence as u8; 50]);
        }
    }
    drop(keeper);
    let stored = read(&kept.0, 1, 100).unwrap();
    assert_eq!((stored.sequence, stored.state.unwrap()), (n, vec![n as u8; 50]));
}

#[test]
fn a_file_that_another_keeps_is_refused() {
    let kept = Scratch::new("twice");
    let first = Vault::open(&kept.0, 1, 100).unwrap();
    let second = Vault::open(&kept.0, 1, 100).unwrap_err();
    assert!(second.to_string().contains("another process"), "{second}");
    drop(first);
    assert!(Vault::open(&kept.0, 1, 100).is_ok());
}
