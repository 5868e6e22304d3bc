//! `pursuit detect` on folders of images: the contract, the shipped example, real sequences.

mod support;

use serde_json::Value;
use std::path::{Path, PathBuf};
use support::{Place, pursuit, text};

const EXAMPLE: &str = "tests/data/camouflage";

/// The JSON lines for a folder.
fn detect(folder: &Path, more: &[&str]) -> Vec<Value> {
    let output = pursuit().arg("detect").arg(folder).arg("--json").args(more).output().expect("detect runs");
    let (lines, errors) = text(&output);
    assert!(output.status.success(), "{errors}");
    lines.lines().map(|line| serde_json::from_str(line).expect("one object per line")).collect()
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
    let cases: [(&str, Vec<NewFile>); 4] = [
        ("one image is no pair", vec![("a.pgm", pgm(64, 64))]),
        ("mixed sizes", vec![("a.pgm", pgm(64, 64)), ("b.pgm", pgm(80, 64))]),
        ("a broken image", vec![("a.pgm", pgm(64, 64)), ("b.png", b"\x89PNG\r\n\x1a\nrubbish".to_vec())]),
        ("too small", vec![("a.pgm", pgm(16, 16)), ("b.pgm", pgm(16, 16))]),
    ];
    for (what, files) in cases {
        let place = Place::new();
        let output =
            pursuit().arg("detect").arg(folder_of(&place, &files)).arg("--json").output().expect("runs");
        let (_, errors) = text(&output);
        assert_eq!(output.status.code(), Some(2), "{what}: {errors}");
        assert_eq!(errors.lines().count(), 1, "{what}: {errors}");
        assert!(!errors.contains("panicked"), "{what}: {errors}");
    }
    let output = pursuit().args(["detect", "no/such/folder"]).output().expect("runs");
    assert_eq!(output.status.code(), Some(2));
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
