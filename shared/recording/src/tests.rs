use crate::*;
use pursuit_messages::*;
use std::path::PathBuf;

/// A file of its own, gone at the end.
struct Scratch(PathBuf);

impl Scratch {
    fn new(name: &str) -> Scratch {
        Scratch(std::env::temp_dir().join(format!("pursuit-recording-{}-{name}.mcap", std::process::id())))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

/// Every kind of message for each of so many frames of 32 x 24 px, 40 ms apart.
fn entries(frames: u64) -> Vec<Entry> {
    let mut all = Vec::new();
    for frame in 0..frames {
        let log_ns = 1_000 + frame * 40_000_000;
        let mut stamp = Stamp::new(7, frame, frame * 40_000_000, ImageShape::grey(32, 24));
        stamp = stamp.extended(Service::Acquisition, Stage::Expose, frame, frame + 3);
        let mut votes = Votes { valid: 1, interval: 1, columns: 16, rows: 16, ..Votes::default() };
        votes.fields[3][5] = frame as f32 * 0.1;
        votes.candidates[1].u = 1.0 / 3.0;
        let motion = Detection { found: 1, u: 3.25, v: -0.0, contrast: f64::NAN, ..Detection::default() };
        let motion = Detection { contrast: if frame == 0 { 1.0 } else { motion.contrast }, ..motion };
        let pixels = (0..32 * 24).map(|k| (k as u64 * 7 + frame) as u8).collect();
        let samples = [
            Sample::World(Box::new(WorldState {
                time_ns: 5,
                camera_position: [0.6, 0.0, 0.5],
                ..WorldState::default()
            })),
            Sample::Frame(pixels),
            Sample::Votes(Box::new(votes)),
            Sample::Target(Box::new(Target { motion, ..Target::default() })),
            Sample::Joints(Joints { position: [0.5; 6], ..Joints::default() }),
            Sample::SetPoint(SetPoint { follow: 1, ..SetPoint::default() }),
            Sample::Learner(Box::new(LearnerState { loss: 0.5, ..LearnerState::default() })),
            Sample::Command(Box::default()),
            Sample::Driver(DriverState { state: 2, answered: 7, ..DriverState::default() }),
            Sample::Health(Health { pid: 77, refused: 3, ..Health::default() }),
        ];
        all.extend(samples.map(|sample| Entry { log_ns, stamp, sample }));
    }
    all
}

fn write(file: &Scratch, entries: &[Entry]) -> Vec<u8> {
    let mut writer = Writer::create(&file.0, "[run]\nseed = 1\n").unwrap();
    entries.iter().for_each(|entry| writer.write(entry).unwrap());
    writer.finish().unwrap();
    std::fs::read(&file.0).unwrap()
}

/// What can be read, whether the file was closed, and the error at the end of it.
fn read(file: &Scratch) -> (Vec<Entry>, bool, Option<RecordingError>) {
    let mut reader = match Reader::open(&file.0) {
        Ok(reader) => reader,
        Err(error) => return (Vec::new(), false, Some(error)),
    };
    let mut all = Vec::new();
    loop {
        match reader.next_entry() {
            Ok(Some(entry)) => all.push(entry),
            Ok(None) => return (all, reader.is_closed(), None),
            Err(error) => return (all, reader.is_closed(), Some(error)),
        }
    }
}

/// NaN is not equal to itself; its text is.
fn same(a: &[Entry], b: &[Entry]) -> bool {
    format!("{a:?}") == format!("{b:?}")
}

#[test]
fn what_was_written_is_read_back_to_the_bit() {
    let (file, all) = (Scratch::new("round"), entries(30));
    write(&file, &all);
    let (back, closed, error) = read(&file);
    assert!(closed && error.is_none(), "{error:?}");
    assert!(same(&back, &all));
    assert_eq!(Reader::open(&file.0).unwrap().config(), Some("[run]\nseed = 1\n"));
}

#[test]
fn a_file_cut_anywhere_is_read_up_to_its_last_whole_chunk() {
    let (file, all) = (Scratch::new("cut"), entries(40));
    let bytes = write(&file, &all);
    let mut most = 0;
    for cut in (0..bytes.len()).step_by(bytes.len() / 97) {
        std::fs::write(&file.0, &bytes[..cut]).unwrap();
        let (back, closed, error) = read(&file);
        assert!(!closed, "cut at {cut}");
        assert!(same(&back, &all[..back.len()]), "cut at {cut}");
        assert!(back.len() >= most, "cut at {cut}: less than before");
        most = back.len();
        match error {
            None => {}
            Some(RecordingError::Empty) => assert_eq!(cut, 0),
            Some(other) => assert!(cut < 8, "cut at {cut}: {other}"),
        }
    }
    // 0.4 s are at most in a chunk that is not whole.
    assert!(most >= all.len() - 11 * 8 - 8, "{most} of {}", all.len());
}

#[test]
fn a_flipped_bit_is_an_error_or_harmless_and_never_other_data() {
    let (file, all) = (Scratch::new("flip"), entries(12));
    let bytes = write(&file, &all);
    let mut errors = 0;
    for at in (0..bytes.len()).step_by(bytes.len() / 211) {
        let mut broken = bytes.clone();
        broken[at] ^= 1 << (at % 8);
        std::fs::write(&file.0, &broken).unwrap();
        let (back, _, error) = read(&file);
        assert!(same(&back, &all[..back.len()]), "bit flipped in byte {at}");
        errors += usize::from(error.is_some());
    }
    assert!(errors > 150, "only {errors} were noticed");
}

#[test]
fn what_is_no_recording_is_refused_with_its_reason() {
    let file = Scratch::new("foreign");
    let magic = b"\x89MCAP0\r\n".to_vec();
    let huge = |opcode: u8, length: u64| [&magic[..], &[opcode], &length.to_le_bytes(), &[0; 64]].concat();
    let cases = [
        (Vec::new(), "is empty"),
        (b"P5 3 3 255 123456789".to_vec(), "is not an MCAP recording"),
        (huge(0x01, u64::MAX), "limit of 64 MB"),
        (huge(0x05, 65 << 20), "limit of 64 MB"),
        (huge(0x04, 1 << 40), "limit of 64 MB"),
    ];
    for (bytes, wanted) in cases {
        std::fs::write(&file.0, &bytes).unwrap();
        let error = Reader::open(&file.0).err().map(|error| error.to_string()).unwrap_or_default();
        assert!(error.contains(wanted), "{wanted:?}: {error:?}");
    }
    std::fs::write(&file.0, huge(0x06, 63 << 20)).unwrap();
    assert!(Reader::open(&file.0).is_ok_and(|reader| !reader.is_closed()));
}

#[test]
fn images_that_cannot_be_are_refused() {
    let stamp = Stamp::new(1, 2, 3, ImageShape::grey(32, 24));
    let mut bytes = Vec::new();
    proto::image(&stamp, &[9; 32 * 24], &mut bytes);
    assert_eq!(proto::read_image(&bytes, 5, 0).unwrap().stamp, stamp);
    for cut in 0..bytes.len() {
        let Ok(entry) = proto::read_image(&bytes[..cut], 5, 0) else { continue };
        assert_eq!(entry.stamp.image, stamp.image, "cut at {cut}");
    }
    let wide = Stamp::new(1, 2, 3, ImageShape::grey(9000, 1));
    proto::image(&wide, &[0; 9000], &mut bytes);
    assert!(matches!(proto::read_image(&bytes, 5, 0), Err(RecordingError::TooLarge { .. })));
    proto::image(&stamp, &[9; 7], &mut bytes);
    assert!(matches!(proto::read_image(&bytes, 5, 0), Err(RecordingError::Damaged { .. })));
}

#[test]
fn another_version_of_a_topic_is_refused_by_name() {
    let file = Scratch::new("version");
    let bytes = write(&file, &entries(1));
    let mine = Topic::Target.schema();
    let other = format!("{}9", &mine[..mine.len() - 1]);
    let at = bytes.windows(mine.len()).position(|window| window == mine.as_bytes()).unwrap();
    let mut broken = bytes.clone();
    broken[at..at + mine.len()].copy_from_slice(other.as_bytes());
    // The sum over the chunk would tell first; 0 means that there is none.
    let chunk = bytes.windows(8).position(|w| w == &1_000_u64.to_le_bytes()[..]).unwrap();
    broken[chunk + 24..chunk + 28].fill(0);
    std::fs::write(&file.0, &broken).unwrap();
    let error = Reader::open(&file.0).err().map(|error| error.to_string()).unwrap_or_default();
    assert!(error.contains(&other) && error.contains(&mine), "{error:?}");
}
