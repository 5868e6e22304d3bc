use std::path::Path;

use super::*;
use pursuit_images::{Limits, list, load_grey, write_png_grey};

const SIDE: u32 = 128;

/// The built-in config's detector.
fn detection() -> Detection {
    crate::check::detection(None, &[]).unwrap()
}

/// A folder of its own for one test, removed at its end.
struct Folder(PathBuf);

impl Folder {
    fn new(test: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("pursuit-detect-{}-{test}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    /// Writes `count` frames: a random texture at rest and a square of 20 px with another texture, its
    /// top-left corner at (30 + 4 i, 50).
    fn with_frames(test: &str, count: u32) -> Folder {
        let folder = Folder::new(test);
        for i in 0..count {
            let left = 30 + 4 * i;
            let pixels: Vec<u8> = (0..SIDE * SIDE)
                .map(|index| {
                    let (u, v) = (index % SIDE, index / SIDE);
                    let inside = (left..left + 20).contains(&u) && (50..70).contains(&v);
                    if inside { texture(u + 1000 - left, v + 500) } else { texture(u, v) }
                })
                .collect();
            write_png_grey(&folder.0.join(format!("f{i}.png")), SIDE, SIDE, &pixels).unwrap();
        }
        folder
    }

    fn options(&self, json: bool) -> Options {
        Options { path: self.0.clone(), json, ..Options::default() }
    }

    fn run(&self, options: &Options) -> (Result<Option<String>, DetectError>, String) {
        let mut out = Vec::new();
        let result = run(options, &detection(), &mut out);
        (result, String::from_utf8(out).unwrap())
    }

    fn complaint(&self) -> String {
        let text = self.run(&self.options(true)).0.unwrap_err().to_string();
        assert_eq!(text.lines().count(), 1, "{text}");
        assert!(text.starts_with(&*self.0.to_string_lossy()), "{text}");
        text
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Value noise of 4 px.
fn texture(u: u32, v: u32) -> u8 {
    let hash = |x: u32, y: u32| {
        let mixed = (x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca6b)).wrapping_mul(0xc2b2_ae35);
        f64::from(mixed >> 24)
    };
    let (x, y) = (u / 4, v / 4);
    let (a, b) = (f64::from(u % 4) / 4.0, f64::from(v % 4) / 4.0);
    let row = |y| hash(x, y) * (1.0 - a) + hash(x + 1, y) * a;
    (row(y) * (1.0 - b) + row(y + 1) * b) as u8
}

#[test]
fn each_image_gives_one_json_line_and_the_target_is_found() {
    let folder = Folder::with_frames("json", 12);
    std::fs::write(folder.0.join("notes.txt"), "passed over").unwrap();
    let (result, out) = folder.run(&folder.options(true));
    result.unwrap();
    let lines: Vec<serde_json::Value> = out.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(lines.len(), 12);
    let keys = ["background", "file", "frame", "pair", "target", "us"];
    let mut near = 0;
    for (frame, line) in lines.iter().enumerate() {
        let mut found: Vec<&str> = line.as_object().unwrap().keys().map(String::as_str).collect();
        found.sort_unstable();
        assert_eq!(found, keys);
        for answer in ["target", "pair"].map(|key| &line[key]).into_iter().filter(|answer| !answer.is_null())
        {
            let numbers = ["u", "v", "vu", "vv", "confidence", "area_px", "velocity_sd"];
            assert!(numbers.iter().all(|key| answer[key].is_f64()), "{answer}");
            assert_eq!(answer["position_covariance"].as_array().unwrap().len(), 3, "{answer}");
            assert!(answer["coasting"].is_boolean() && answer.get("track").is_some(), "{answer}");
        }
        assert_eq!(line["frame"], frame);
        assert_eq!(line["file"], format!("f{frame}.png"));
        assert!(line["background"]["vu"].is_f64() && line["us"]["votes"].is_f64());
        let centre = (39.5 + 4.0 * frame as f64, 59.5);
        if let (Some(u), Some(v)) = (line["target"]["u"].as_f64(), line["target"]["v"].as_f64()) {
            near += usize::from((u - centre.0).hypot(v - centre.1) < 10.0);
        }
    }
    assert!(lines[0]["target"].is_null());
    assert!(near >= 8, "{near} of 11 near the target:\n{out}");
}

#[test]
fn the_table_has_a_row_for_each_image_and_a_summary() {
    let folder = Folder::with_frames("table", 3);
    let (result, out) = folder.run(&folder.options(false));
    result.unwrap();
    let lines: Vec<&str> = out.lines().collect();
    assert_eq!(lines.len(), 2 + 3 + 2, "{out}");
    assert!(lines[2].contains("f0.png") && lines[2].ends_with("there is no frame before this one"));
    assert!(lines[5].starts_with("a target in ") && lines[5].ends_with(" of 2 pairs"));
}

fn load(path: &Path) -> GreyImage {
    load_grey(path, Limits::default()).unwrap()
}

#[test]
fn annotated_images_are_copies_with_the_detection_drawn_in() {
    let folder = Folder::with_frames("annotate", 3);
    std::fs::copy(folder.0.join("f2.png"), folder.0.join("f3.tif")).unwrap();
    let copies = folder.0.join("a/b");
    let options = Options { annotate: Some(copies.clone()), ..folder.options(true) };
    folder.run(&options).0.unwrap();
    let names: Vec<PathBuf> =
        ["f0.png", "f1.png", "f2.png", "f3.tif.png"].map(|name| copies.join(name)).into();
    assert_eq!(list(&copies).unwrap(), names);
    for name in ["f0.png", "f1.png"] {
        let (copy, image) = (load(&copies.join(name)), load(&folder.0.join(name)));
        let drawn = copy.pixels.iter().zip(&image.pixels).filter(|(copy, image)| copy != image).count();
        assert!((1..image.pixels.len() / 4).contains(&drawn), "{name}: {drawn} pixels");
    }
}

#[test]
fn pictures_replace_neither_the_images_nor_each_other() {
    let folder = Folder::with_frames("replace", 2);
    let pictures = folder.0.join("a");
    let over_images = Options { fields: Some(pictures.join("..")), ..folder.options(true) };
    std::fs::create_dir(&pictures).unwrap();
    let refused = folder.run(&over_images).0.unwrap_err().to_string();
    assert!(refused.ends_with("holds the images themselves, give --fields another folder"), "{refused}");
    let twice = Options { annotate: Some(pictures.clone()), figure2: Some(pictures), ..folder.options(true) };
    let refused = folder.run(&twice).0.unwrap_err().to_string();
    assert!(refused.ends_with("holds other pictures, give --figure2 another folder"), "{refused}");
}

#[test]
fn what_cannot_be_worked_through_is_named_in_one_line() {
    let folder = Folder::with_frames("bad", 1);
    assert!(folder.complaint().ends_with("images in this folder: 1; at least 2 are needed to see a motion"));
    let second = folder.0.join("f1.png");
    write_png_grey(&second, 64, 128, &[0; 64 * 128]).unwrap();
    assert!(folder.complaint().ends_with("f1.png: is 64x128 pixels, must be 128x128"));
    std::fs::write(&second, b"\x89PNG\r\n\x1a\ngarbage").unwrap();
    assert!(folder.complaint().contains("f1.png: is not a whole image: "));
    for name in ["f0.png", "f1.png"] {
        write_png_grey(&folder.0.join(name), 8, 8, &[0; 64]).unwrap();
    }
    assert!(folder.complaint().contains("f0.png: is 8x8 pixels, each side must be 64 to 4096 pixels"));
}

#[test]
fn a_path_that_is_neither_folder_nor_video_is_named() {
    let folder = Folder::with_frames("paths", 2);
    let complaint = |path: &Path| {
        let options = Options { path: path.to_owned(), ..Options::default() };
        run(&options, &detection(), &mut Vec::new()).unwrap_err().to_string()
    };
    assert!(complaint(&folder.0.join("gone")).ends_with("gone: there is no such folder or file"));
    assert!(complaint(&folder.0.join("f0.png")).contains("f0.png: is one image, give the folder"));
    assert!(complaint(Path::new("/dev/null")).ends_with("neither a folder of images nor a video file"));
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    struct Closed;
    impl Write for Closed {
        fn write(&mut self, _: &[u8]) -> io::Result<usize> {
            Err(ErrorKind::BrokenPipe.into())
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }
    let folder = Folder::with_frames("closed", 2);
    for json in [true, false] {
        assert!(run(&folder.options(json), &detection(), &mut Closed).is_ok());
    }
}

#[test]
fn with_each_part_of_the_detector_switched_off_every_frame_is_answered() {
    let folder = Folder::with_frames("parts", 4);
    for part in ["light", "search", "competition", "symmetric", "turn", "untuned"] {
        let detection = crate::check::detection(None, &[format!("vision.{part}=false")]).unwrap();
        let mut out = Vec::new();
        run(&folder.options(true), &detection, &mut out).unwrap();
        assert_eq!(String::from_utf8(out).unwrap().lines().count(), 4, "without {part}");
    }
}
