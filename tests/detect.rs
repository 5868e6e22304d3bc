//! `pursuit detect` on folders of images and on videos: the contract, the shipped example, real sequences.

mod support;

use pursuit_images::{GreyImage, Limits, list, load_grey, write_png_rgb};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use support::{Place, pursuit, text};

const EXAMPLE: &str = "tests/data/camouflage";

fn output_of(path: &Path, more: &[&str]) -> Output {
    pursuit().arg("detect").arg(path).arg("--json").args(more).output().expect("detect runs")
}

/// The JSON lines for a folder or a video.
fn detect(path: &Path, more: &[&str]) -> Vec<Value> {
    let output = output_of(path, more);
    let (lines, errors) = text(&output);
    assert!(output.status.success(), "{errors}");
    lines.lines().map(|line| serde_json::from_str(line).expect("one object per line")).collect()
}

/// What was found, without what depends on the file's name and on the clock.
fn found(lines: &[Value]) -> Vec<(Value, Value)> {
    lines.iter().map(|line| (line["target"].clone(), line["background"].clone())).collect()
}

/// The one line that a run ends with that cannot go on.
fn complaint(output: &Output) -> String {
    let (_, errors) = text(output);
    assert_eq!(output.status.code(), Some(2), "{errors}");
    assert_eq!(errors.lines().count(), 1, "{errors}");
    assert!(!errors.contains("panicked"), "{errors}");
    errors
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("a number, not {value}"))
}

#[test]
fn every_line_is_as_the_contract_says() {
    let lines = detect(Path::new(EXAMPLE), &[]);
    assert_eq!(lines.len(), 12);
    assert!(lines[0]["target"].is_null(), "the first frame has no pair");
    for (index, line) in lines.iter().enumerate() {
        assert_eq!(line["frame"], index);
        assert_eq!(line["file"], format!("f{index:02}.png"));
        for key in ["vu", "vv"] {
            assert!(number(&line["background"][key]).is_finite());
        }
        for key in ["pyramid", "votes", "compensation", "segmentation"] {
            assert!(number(&line["us"][key]) >= 0.0);
        }
        if !line["target"].is_null() {
            for key in ["u", "v", "vu", "vv", "area_px"] {
                assert!(number(&line["target"][key]).is_finite());
            }
            assert!((0.0..=1.0).contains(&number(&line["target"]["confidence"])));
        }
    }
}

/// The vehicle of the example is 68 by 45 px in images of 320 px. A hit is what is within half of the root
/// of the target's area and 2 % of the image's width.
const HIT_PX: f64 = 27.6 + 6.4;

#[test]
fn the_camouflaged_vehicle_of_the_example_is_found() {
    let truth = support::json(&Path::new(EXAMPLE).join("truth.json"));
    let lines = detect(Path::new(EXAMPLE), &[]);
    let truth = truth.as_array().expect("a list");
    let hits = lines.iter().zip(truth).skip(1).filter(|(line, truth)| {
        let target = &line["target"];
        let off = |axis: &str| target[axis].as_f64().map_or(f64::INFINITY, |t| t - number(&truth[axis]));
        off("u").hypot(off("v")) < HIT_PX
    });
    let hits = hits.count();
    assert!(hits >= 10, "{hits} of 11");
}

#[test]
fn annotated_images_are_written() {
    let place = Place::new();
    let folder = place.file("annotated");
    detect(Path::new(EXAMPLE), &["--annotate", &folder.display().to_string()]);
    let images = std::fs::read_dir(&folder).expect("the folder").flatten().count();
    assert_eq!(images, 12);
}

fn load(path: &Path) -> GreyImage {
    load_grey(path, Limits { max_side: 1 << 15, ..Limits::default() }).expect("an image")
}

/// Names and sizes of the pictures in a folder.
fn pictures(folder: &Path) -> Vec<(String, (u32, u32))> {
    let describe = |path: &PathBuf| {
        let image = load(path);
        (path.file_name().expect("a name").to_string_lossy().into_owned(), (image.width, image.height))
    };
    list(folder).expect("a folder").iter().map(describe).collect()
}

#[test]
fn figures_2_and_4_are_written_for_each_frame() {
    let place = Place::new();
    let (fields, figure2) = (place.file("fields"), place.file("figure2"));
    let options = [
        "--fields".to_owned(),
        fields.display().to_string(),
        "--figure2".into(),
        figure2.display().to_string(),
    ];
    detect(Path::new(EXAMPLE), &options.each_ref().map(String::as_str));
    let names = |from: usize| (from..12).map(|frame| format!("f{frame:02}.png")).collect::<Vec<_>>();
    // Four fields of 20x16 cells of 8 px in a row, three rows, gaps of 6 px, lines of 7 px.
    let size = (6 + 4 * (20 * 8 + 6), 3 * (13 + 16 * 8 + 6) + 13 + 6);
    let expected: Vec<_> = names(1).into_iter().map(|name| (name, size)).collect();
    assert_eq!(pictures(&fields), expected, "there is no pair at the first frame");
    // Four pictures of the frame's size in a row, two rows, lines of 14 px.
    let size = (6 + 4 * (320 + 6), 2 * (20 + 256 + 6) + 20 + 6);
    let expected: Vec<_> = names(0).into_iter().map(|name| (name, size)).collect();
    assert_eq!(pictures(&figure2), expected);
}

/// A file to be: its name and its bytes.
type NewFile = (&'static str, Vec<u8>);

/// A folder with some files.
fn folder_of(place: &Place, files: &[NewFile]) -> PathBuf {
    let folder = place.file("images");
    std::fs::create_dir_all(&folder).expect("a folder");
    for (name, bytes) in files {
        std::fs::write(folder.join(name), bytes).expect("a file");
    }
    folder
}

fn pgm(width: usize, height: usize) -> Vec<u8> {
    let mut bytes = format!("P5 {width} {height} 255\n").into_bytes();
    bytes.extend((0..width * height).map(|k| (k * 7919 % 251) as u8));
    bytes
}

#[test]
fn files_come_in_natural_order_and_others_are_passed_over() {
    let place = Place::new();
    let image = pgm(64, 64);
    let names = ["f10.pgm", "f2.pgm", "f1.pgm", "meta.json"];
    let files: Vec<NewFile> = names.map(|name| (name, image.clone())).to_vec();
    let lines = detect(&folder_of(&place, &files), &[]);
    let seen: Vec<&str> = lines.iter().map(|l| l["file"].as_str().expect("a name")).collect();
    assert_eq!(seen, ["f1.pgm", "f2.pgm", "f10.pgm"]);
    assert!(lines.iter().all(|l| l["target"].is_null()), "nothing moves");
}

#[test]
fn bad_folders_give_one_clear_line_and_exit_code_2() {
    let cases: [(&str, Vec<NewFile>); 5] = [
        ("one image is no pair", vec![("a.pgm", pgm(64, 64))]),
        ("mixed sizes", vec![("a.pgm", pgm(64, 64)), ("b.pgm", pgm(80, 64))]),
        ("a broken image", vec![("a.pgm", pgm(64, 64)), ("b.png", b"\x89PNG\r\n\x1a\nrubbish".to_vec())]),
        ("too small", vec![("a.pgm", pgm(63, 80)), ("b.pgm", pgm(63, 80))]),
        ("too large", vec![("a.pgm", pgm(4097, 80)), ("b.pgm", pgm(4097, 80))]),
    ];
    for (what, files) in cases {
        let place = Place::new();
        let errors = complaint(&output_of(&folder_of(&place, &files), &[]));
        assert!(errors.starts_with("pursuit detect: "), "{what}: {errors}");
    }
    let output = pursuit().args(["detect", "no/such/folder"]).output().expect("runs");
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn a_size_out_of_range_is_refused_with_the_range() {
    for (width, height) in [(63, 64), (64, 63), (4097, 2048)] {
        let place = Place::new();
        let folder = folder_of(&place, &[("a.pgm", pgm(width, height)), ("b.pgm", pgm(width, height))]);
        let errors = complaint(&output_of(&folder, &[]));
        let expected = format!("a.pgm: is {width}x{height} pixels, each side must be 64 to 4096 pixels");
        assert!(errors.trim_end().ends_with(&expected), "{errors}");
    }
}

/// The frames of the example.
fn example() -> Vec<GreyImage> {
    list(Path::new(EXAMPLE)).expect("the example").iter().map(|path| load(path)).collect()
}

/// A folder of frames, each written by `write` to the path it is given.
fn folder_with(
    place: &Place,
    frames: &[GreyImage],
    ending: &str,
    write: impl Fn(&Path, &GreyImage),
) -> PathBuf {
    let folder = folder_of(place, &[]);
    for (index, frame) in frames.iter().enumerate() {
        write(&folder.join(format!("f{index}.{ending}")), frame);
    }
    folder
}

/// A kind of file: the ending of its name, and what writes it.
type Kind<'a> = (&'a str, &'a dyn Fn(&Path, &GreyImage));

#[test]
fn depth_and_colour_of_the_files_make_no_difference() {
    let (frames, expected) = (example(), found(&detect(Path::new(EXAMPLE), &[])));
    let header = |kind: &str, frame: &GreyImage, white: u32| {
        format!("{kind} {} {} {white}\n", frame.width, frame.height).into_bytes()
    };
    let wide = |path: &Path, frame: &GreyImage| {
        let values = frame.pixels.iter().flat_map(|&grey| (u16::from(grey) * 257).to_be_bytes());
        let bytes: Vec<u8> = header("P5", frame, 65535).into_iter().chain(values).collect();
        std::fs::write(path, bytes).expect("a file");
    };
    let pixmap = |path: &Path, frame: &GreyImage| {
        let values = frame.pixels.iter().flat_map(|&grey| [grey; 3]);
        let bytes: Vec<u8> = header("P6", frame, 255).into_iter().chain(values).collect();
        std::fs::write(path, bytes).expect("a file");
    };
    let colour = |path: &Path, frame: &GreyImage| {
        let values: Vec<u8> = frame.pixels.iter().flat_map(|&grey| [grey; 3]).collect();
        write_png_rgb(path, frame.width, frame.height, &values).expect("a file");
    };
    let kinds: [Kind<'_>; 3] = [("pgm", &wide), ("ppm", &pixmap), ("png", &colour)];
    for (ending, write) in kinds {
        let place = Place::new();
        let folder = folder_with(&place, &frames, ending, write);
        assert_eq!(found(&detect(&folder, &[])), expected, "{ending}");
    }
}

/// The frame without its last columns and rows.
fn cropped(frame: &GreyImage, width: u32, height: u32) -> GreyImage {
    let rows = frame.pixels.chunks(frame.width as usize).take(height as usize);
    GreyImage { width, height, pixels: rows.flat_map(|row| row[..width as usize].to_vec()).collect() }
}

fn write_pgm(path: &Path, frame: &GreyImage) {
    let head = format!("P5 {} {} 255\n", frame.width, frame.height).into_bytes();
    std::fs::write(path, [head, frame.pixels.clone()].concat()).expect("a file");
}

#[test]
fn odd_sizes_are_answered_and_drawn() {
    for (width, height) in [(319, 255), (257, 131), (65, 127)] {
        let frames: Vec<_> = example().iter().take(3).map(|frame| cropped(frame, width, height)).collect();
        let place = Place::new();
        let folder = folder_with(&place, &frames, "pgm", write_pgm);
        let kinds = ["--annotate", "--fields", "--figure2"];
        let folders = kinds.map(|kind| place.file(kind).display().to_string());
        let options: Vec<&str> = kinds.iter().zip(&folders).flat_map(|(kind, at)| [*kind, at]).collect();
        assert_eq!(detect(&folder, &options).len(), 3);
        let count = folders.each_ref().map(|folder| pictures(Path::new(folder)).len());
        assert_eq!(count, [3, 2, 3], "{width}x{height}");
        assert!(pictures(Path::new(&folders[0])).iter().all(|(_, size)| *size == (width, height)));
    }
}

/// Makes `video` of the example's frames; `false`, and a word of it, where there is no ffmpeg.
fn encode(video: &Path, more: &[&str]) -> bool {
    std::fs::create_dir_all(video.parent().expect("a folder")).expect("a folder");
    let mut command = Command::new("ffmpeg");
    command.args(["-nostdin", "-v", "error", "-i"]).arg(Path::new(EXAMPLE).join("f%02d.png")).args(more);
    match command.arg(video).stdin(Stdio::null()).status() {
        Ok(status) => {
            assert!(status.success(), "ffmpeg makes {}", video.display());
            true
        }
        Err(error) => {
            eprintln!("skipped: ffmpeg is not installed ({error})");
            false
        }
    }
}

#[test]
fn a_video_gives_what_its_frames_in_a_folder_give() {
    let expected = found(&detect(Path::new(EXAMPLE), &[]));
    for (codec, name) in [("ffv1", "clip.mkv"), ("png", "a clip: 1.mov")] {
        let place = Place::new();
        let video = place.file(name);
        if !encode(&video, &["-c:v", codec]) {
            return;
        }
        let folder = place.file("annotated");
        let lines = detect(&video, &["--annotate", &folder.display().to_string()]);
        assert_eq!(found(&lines), expected, "{codec}");
        assert!(lines.iter().all(|line| line["file"] == name));
        let stem = video.file_stem().expect("a name").to_string_lossy();
        let names: Vec<String> = pictures(&folder).into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, (0..12).map(|frame| format!("{stem}-{frame:06}.png")).collect::<Vec<_>>());
    }
}

#[test]
fn no_frame_of_an_uneven_video_comes_twice_or_is_left_out() {
    let place = Place::new();
    let video = place.file("uneven.mkv");
    // The last six frames come at a third of the rate.
    let uneven = ["-vf", "setpts='if(lt(N,6),N,6+(N-6)*3)/(25*TB)'", "-c:v", "ffv1"];
    if encode(&video, &uneven) {
        assert_eq!(found(&detect(&video, &[])), found(&detect(Path::new(EXAMPLE), &[])));
    }
}

#[test]
fn a_video_in_colour_and_of_a_lossy_codec_is_answered() {
    let place = Place::new();
    let video = place.file("clip.avi");
    if encode(&video, &["-c:v", "mjpeg", "-q:v", "2", "-pix_fmt", "yuvj420p"]) {
        let lines = detect(&video, &[]);
        assert_eq!(lines.len(), 12);
        assert!(lines.iter().filter(|line| !line["target"].is_null()).count() >= 8);
    }
}

#[test]
fn a_video_that_ends_early_is_answered_as_far_as_it_goes_and_that_is_said() {
    let place = Place::new();
    let video = place.file("clip.mkv");
    if !encode(&video, &["-c:v", "ffv1"]) {
        return;
    }
    let whole = std::fs::read(&video).expect("the video");
    std::fs::write(&video, &whole[..whole.len() / 2]).expect("half of it");
    let output = output_of(&video, &[]);
    let (lines, errors) = text(&output);
    assert!(output.status.success(), "{errors}");
    assert!((3..12).contains(&lines.lines().count()), "{lines}");
    assert!(errors.contains("clip.mkv: ffmpeg went on, but says: "), "{errors}");
}

#[test]
fn what_is_no_video_is_named_in_one_line() {
    let place = Place::new();
    let folder = folder_of(&place, &[("words.mp4", b"no video\n".to_vec()), ("one.png", Vec::new())]);
    assert!(complaint(&output_of(&folder.join("one.png"), &[])).contains("one.png: is one image"));
    let video = folder.join("words.mp4");
    if !encode(&place.file("tiny.mkv"), &["-c:v", "ffv1", "-vf", "scale=48:48"]) {
        return;
    }
    assert!(complaint(&output_of(&video, &[])).contains("words.mp4: ffmpeg cannot decode it: "));
    let errors = complaint(&output_of(&place.file("tiny.mkv"), &[]));
    assert!(errors.contains("tiny.mkv: is 48x48 pixels, each side must be 64 to 4096 pixels"), "{errors}");
    assert!(encode(&place.file("one.mkv"), &["-c:v", "ffv1", "-frames:v", "1"]));
    let errors = complaint(&output_of(&place.file("one.mkv"), &[]));
    assert!(errors.contains("one.mkv: frames in this video: 1; at least 2 are needed"), "{errors}");
}

#[test]
fn without_ffmpeg_a_video_is_refused_with_what_to_do() {
    let place = Place::new();
    let video = folder_of(&place, &[("clip.mp4", Vec::new())]).join("clip.mp4");
    let empty = place.file("empty");
    std::fs::create_dir_all(&empty).expect("a folder");
    let output = pursuit().arg("detect").arg(&video).env("PATH", &empty).output().expect("detect runs");
    let errors = complaint(&output);
    assert!(errors.contains("install the package ffmpeg"), "{errors}");
    assert!(errors.contains("/%06d.png"), "{errors}");
}

/// Where real sequences lie on a machine that has them.
fn sequences() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data");
    folder.is_dir().then_some(folder)
}

#[test]
fn real_sequences_are_answered_frame_by_frame() {
    let Some(data) = sequences() else {
        eprintln!("skipped: no ../shared/data with real image sequences here");
        return;
    };
    let mut seen = 0;
    for entry in std::fs::read_dir(data).expect("the folder").flatten() {
        let folder = entry.path();
        if !folder.join("meta.json").exists() {
            continue;
        }
        let meta = support::json(&folder.join("meta.json"));
        let lines = detect(&folder, &[]);
        assert_eq!(lines.len() as u64, meta["frames"].as_u64().expect("frames"), "{}", folder.display());
        let (width, height) = (number(&meta["width"]), number(&meta["height"]));
        for line in lines.iter().filter(|line| !line["target"].is_null()) {
            let (u, v) = (number(&line["target"]["u"]), number(&line["target"]["v"]));
            let inside =
                (-0.1 * width..1.1 * width).contains(&u) && (-0.1 * height..1.1 * height).contains(&v);
            assert!(inside, "{}: {line}", folder.display());
        }
        seen += 1;
    }
    assert!(seen > 0, "the folder holds sequences");
}

/// The truth's boxes [x, y, w, h] at a frame: between frames whose boxes were read off, in between.
fn boxes(meta: &Value, frame: u64) -> Vec<[f64; 4]> {
    let truth = meta["truth"].as_object().expect("truth by frame");
    let at = |key: u64| -> Vec<[f64; 4]> {
        let boxes = truth[&key.to_string()].as_array().expect("boxes");
        boxes.iter().map(|b| [0, 1, 2, 3].map(|i| number(&b[i]))).collect()
    };
    let keys = || truth.keys().filter_map(|key| key.parse::<u64>().ok());
    let before = keys().filter(|key| *key <= frame).max();
    let after = keys().filter(|key| *key >= frame).min();
    match (before, after) {
        (Some(first), Some(last)) if first < last => {
            let part = (frame - first) as f64 / (last - first) as f64;
            let blend = |(a, b): (&[f64; 4], &[f64; 4])| std::array::from_fn(|i| a[i] + part * (b[i] - a[i]));
            at(first).iter().zip(&at(last)).map(blend).collect()
        }
        (Some(key), _) | (None, Some(key)) => at(key),
        (None, None) => Vec::new(),
    }
}

/// Least share of pairs whose best answer, and whose target, must lie inside the truth, and most false alarms:
/// what the detector is meant to reach. Its confidence was fitted with these sequences among others, so this
/// guards against getting worse and measures nothing.
const BEST_ANSWER_INSIDE: f64 = 0.88;
const TARGET_INSIDE: f64 = 0.92;
const FALSE_ALARMS: f64 = 0.05;

#[test]
fn targets_of_real_sequences_are_found_and_nothing_is_seen_where_nothing_moves() {
    let Some(data) = sequences() else {
        eprintln!("skipped: no ../shared/data with real image sequences here");
        return;
    };
    let (mut pairs, mut alone, mut tracked) = (0u32, 0u32, 0u32);
    let (mut empty, mut alarms) = (0u32, 0u32);
    for entry in std::fs::read_dir(data).expect("the folder").flatten() {
        let folder = entry.path();
        if !folder.join("meta.json").exists() {
            continue;
        }
        let meta = support::json(&folder.join("meta.json"));
        for (frame, line) in detect(&folder, &[]).iter().enumerate().skip(1) {
            let boxes = boxes(&meta, frame as u64);
            if boxes.is_empty() {
                empty += 1;
                alarms += u32::from(!line["target"].is_null());
                continue;
            }
            let inside = |answer: &Value| {
                let at = |b: &[f64; 4]| {
                    let (u, v) = (number(&answer["u"]) - b[0], number(&answer["v"]) - b[1]);
                    (0.0..=b[2]).contains(&u) && (0.0..=b[3]).contains(&v)
                };
                !answer.is_null() && boxes.iter().any(at)
            };
            pairs += 1;
            alone += u32::from(inside(&line["pair"]));
            tracked += u32::from(inside(&line["target"]));
        }
    }
    eprintln!("of {pairs} pairs: best answer inside {alone}, target {tracked}; alarms {alarms} of {empty}");
    assert!(pairs > 0 && empty > 0, "the folder holds sequences of both kinds");
    assert!(f64::from(alone) >= BEST_ANSWER_INSIDE * f64::from(pairs), "{alone} of {pairs} pairs");
    assert!(f64::from(tracked) >= TARGET_INSIDE * f64::from(pairs), "{tracked} of {pairs} pairs with tracks");
    assert!(f64::from(alarms) <= FALSE_ALARMS * f64::from(empty), "{alarms} false alarms in {empty} pairs");
}
