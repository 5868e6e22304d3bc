use super::*;
use pursuit_messages::topics::{Healths, SetPoints, VoteFields, WorldStates};
use pursuit_messages::{Health, ImageShape, SetPoint, WorldState};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};

/// A run-time directory of its own, gone at the end.
struct Cell {
    instance: Instance,
    directory: PathBuf,
}

impl Cell {
    fn new() -> Cell {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let directory = PathBuf::from(format!("/tmp/pb{}-{number}", std::process::id()));
        Cell { instance: Instance::at(&directory).unwrap(), directory }
    }
}

impl Drop for Cell {
    fn drop(&mut self) {
        self.instance.wipe();
        let _ = std::fs::remove_dir_all(&self.directory);
    }
}

fn stamp(frame: u64) -> Stamp {
    Stamp::new(1, frame, 0, ImageShape::grey(8, 4))
}

const LIMIT: Duration = Duration::from_millis(20);

#[test]
fn what_is_published_is_received_with_its_stamp() {
    let cell = Cell::new();
    let bus = Bus::join(&cell.instance, "test").unwrap();
    let writer = bus.publisher(SetPoints).unwrap();
    let reader = bus.subscriber(SetPoints).unwrap();
    let sent = SetPoint { follow: 1, position: [0.5, -0.25], ..SetPoint::default() };
    writer.publish(&stamp(7), &sent).unwrap();
    wait(&[&reader], LIMIT).unwrap();
    let message = reader.receive().unwrap().unwrap();
    assert_eq!(*message.payload(), sent);
    assert_eq!(message.stamp().frame, 7);
    assert!(reader.receive().unwrap().is_none());
}

#[test]
fn the_newest_message_wins_and_the_others_are_counted() {
    let cell = Cell::new();
    let bus = Bus::join(&cell.instance, "test").unwrap();
    let writer = bus.publisher(SetPoints).unwrap();
    let reader = bus.subscriber(SetPoints).unwrap();
    for frame in 0..3 {
        writer.publish(&stamp(frame), &SetPoint::default()).unwrap();
    }
    let (message, passed) = reader.newest().unwrap().unwrap();
    assert_eq!((message.stamp().frame, passed), (2, 2));
}

#[test]
fn a_late_reader_gets_the_history() {
    let cell = Cell::new();
    let bus = Bus::join(&cell.instance, "test").unwrap();
    let writer = bus.publisher(WorldStates).unwrap();
    for frame in 0..12 {
        writer.publish(&stamp(frame), &WorldState::default()).unwrap();
    }
    let reader = bus.subscriber(WorldStates).unwrap();
    writer.greet_new_readers();
    let frames: Vec<u64> =
        std::iter::from_fn(|| reader.receive().unwrap()).map(|message| message.stamp().frame).collect();
    assert_eq!(frames, (3..12).collect::<Vec<_>>());
}

#[test]
fn a_frame_is_read_where_it_was_written() {
    let cell = Cell::new();
    let bus = Bus::join(&cell.instance, "test").unwrap();
    let writer = bus.frame_publisher(32).unwrap();
    let reader = bus.frame_subscriber().unwrap();
    let mut loan = writer.loan(32).unwrap();
    loan.pixels_mut().iter_mut().zip(0..).for_each(|(pixel, value)| *pixel = value);
    loan.send(&stamp(1)).unwrap();
    let frame = reader.receive().unwrap().unwrap();
    assert_eq!(frame.pixels(), (0..32).collect::<Vec<u8>>());
}

#[test]
fn the_pools_have_the_size_that_the_budget_says() {
    let cell = Cell::new();
    let bus = Bus::join(&cell.instance, "test").unwrap();
    let _writers = [bus.frame_publisher(512 * 512).unwrap(), bus.frame_publisher(512 * 512).unwrap()];
    let size = |object: &std::path::PathBuf| std::fs::metadata(object).unwrap().len() as usize;
    let all: usize = cell.instance.shared_memory_objects().iter().map(size).sum();
    let budget = memory_budget(512 * 512);
    assert!((budget / 2..=budget).contains(&all), "{all} bytes, budget {budget}");
}

#[test]
fn what_a_port_will_use_is_there_from_the_beginning() {
    use std::os::unix::fs::MetadataExt;
    let cell = Cell::new();
    let bus = Bus::join(&cell.instance, "test").unwrap();
    let _ports = (bus.publisher(WorldStates).unwrap(), bus.subscriber(WorldStates).unwrap());
    for object in cell.instance.shared_memory_objects() {
        let about = std::fs::metadata(&object).unwrap();
        assert!(about.blocks() * 512 >= about.len(), "{} of {}", about.blocks() * 512, about.len());
    }
}

#[test]
fn a_frame_whose_header_does_not_fit_is_refused_and_counted() {
    let cell = Cell::new();
    let bus = Bus::join(&cell.instance, "test").unwrap();
    let writer = bus.frame_publisher(64).unwrap();
    let reader = bus.frame_subscriber().unwrap();
    writer.loan(64).unwrap().send(&stamp(1)).unwrap();
    let mut foreign = stamp(2);
    foreign.layout = 999;
    writer.loan(32).unwrap().send(&foreign).unwrap();
    assert!(reader.receive().unwrap().is_none());
    assert_eq!(reader.refused(), 2);
}

#[test]
fn two_instances_never_meet() {
    let (one, other) = (Cell::new(), Cell::new());
    assert_ne!(one.instance.prefix(), other.instance.prefix());
    let writer = Bus::join(&one.instance, "a").unwrap().publisher(Healths).unwrap();
    let reader = Bus::join(&other.instance, "b").unwrap().subscriber(Healths).unwrap();
    writer.publish(&stamp(1), &Health::default()).unwrap();
    wait(&[&reader], LIMIT).unwrap();
    assert!(reader.receive().unwrap().is_none());
}

#[test]
fn another_payload_under_the_same_name_is_refused_by_name() {
    #[derive(Clone, Copy)]
    struct Impostor;
    impl Topic for Impostor {
        type Payload = Health;
        const NAME: &'static str = VoteFields::NAME;
        const QUALITY: Quality = VoteFields::QUALITY;
        const OF_ONE_CAMERA: bool = true;
    }
    let cell = Cell::new();
    let bus = Bus::join(&cell.instance, "test").unwrap();
    let _held = bus.hold_all_topics().unwrap();
    let error = bus.publisher(Impostor).err().unwrap();
    assert!(error.is_version(), "{error}");
    assert!(error.to_string().contains(VoteFields::NAME), "{error}");
}

#[test]
fn nothing_is_left_after_a_wipe() {
    let cell = Cell::new();
    {
        let bus = Bus::join(&cell.instance, "test").unwrap();
        let held = bus.hold_all_topics().unwrap();
        assert_eq!(held.count(), 10);
        let writer = bus.frame_publisher(1 << 16).unwrap();
        assert!(!cell.instance.shared_memory_objects().is_empty());
        std::mem::forget(writer);
    }
    cell.instance.wipe();
    assert!(cell.instance.shared_memory_objects().is_empty());
    assert!(!cell.directory.join("iox").exists());
}

#[test]
fn a_path_too_long_for_a_socket_is_refused_with_its_length() {
    let error = Instance::at(&PathBuf::from(format!("/tmp/{}", "x".repeat(80)))).err().unwrap();
    assert!(error.to_string().contains("--run-dir"), "{error}");
    let _ = std::fs::remove_dir_all(format!("/tmp/{}", "x".repeat(80)));
}

#[test]
fn a_directory_that_is_not_ours_alone_is_refused_with_the_way_out() {
    use std::os::unix::fs::PermissionsExt;
    let base = PathBuf::from(format!("/tmp/pbp{}", std::process::id()));
    let open = base.join("open");
    std::fs::create_dir_all(&open).unwrap();
    std::fs::set_permissions(&open, std::fs::Permissions::from_mode(0o755)).unwrap();
    let error = Instance::at(&open).err().unwrap().to_string();
    assert!(error.contains("mode 755") && error.contains("chmod 700"), "{error}");
    std::fs::set_permissions(&open, std::fs::Permissions::from_mode(0o700)).unwrap();
    assert!(Instance::at(&open).is_ok());
    std::os::unix::fs::symlink(&open, base.join("link")).unwrap();
    assert!(Instance::at(&base.join("link")).err().unwrap().to_string().contains("is a link"));
    std::fs::remove_dir_all(&base).unwrap();
}

#[test]
fn what_is_of_an_old_epoch_is_refused_and_counted() {
    let cell = Cell::new();
    let bus = Bus::join(&cell.instance, "test").unwrap();
    let writer = bus.publisher(SetPoints).unwrap();
    let reader = bus.reader(SetPoints).unwrap();
    for (epoch, frame) in [(7, 0), (5, 2), (7, 1), (8, 0)] {
        let stamp = Stamp::new(epoch, frame, 0, ImageShape::grey(4, 4));
        writer.publish(&stamp, &SetPoint::default()).unwrap();
    }
    let mut seen = Vec::new();
    while let Some(message) = reader.receive().unwrap() {
        seen.push((message.stamp().epoch, message.stamp().frame));
    }
    assert_eq!(seen, [(7, 0), (7, 1), (8, 0)]);
    assert_eq!(reader.refused(), 1);
}
