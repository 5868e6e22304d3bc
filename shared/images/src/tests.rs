use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageBuffer, ImageFormat, Luma, LumaA, Rgb, Rgba};

use crate::{
    Canvas, GreyImage, ImagesError, Limits, list, load_grey, load_grey_into, write_png_grey, write_png_rgb,
};

/// A folder of its own for one test, removed at its end.
struct Folder(PathBuf);

impl Folder {
    fn new(test: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("pursuit-images-{}-{test}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

const SIZE: (u32, u32) = (21, 13);

fn ramp(u: u32, v: u32) -> u8 {
    (u * 11 + v) as u8
}

fn ramp_image() -> GreyImage {
    let pixels = (0..SIZE.1).flat_map(|v| (0..SIZE.0).map(move |u| ramp(u, v))).collect();
    GreyImage { width: SIZE.0, height: SIZE.1, pixels }
}

fn grey(path: &Path) -> Result<GreyImage, ImagesError> {
    load_grey(path, Limits::default())
}

/// The error's text: one line that names the file.
fn complaint(path: &Path) -> String {
    let text = grey(path).unwrap_err().to_string();
    assert_eq!(text.lines().count(), 1, "{text}");
    assert!(text.starts_with(&format!("{}: ", path.display())), "{text}");
    text
}

#[test]
fn images_of_every_kind_and_depth_come_as_the_same_grey() {
    let folder = Folder::new("kinds");
    let scale = |value: u8| u16::from(value) * 257;
    let images: [(&str, DynamicImage); 8] = [
        ("grey8", ImageBuffer::from_fn(SIZE.0, SIZE.1, |u, v| Luma([ramp(u, v)])).into()),
        ("grey16", ImageBuffer::from_fn(SIZE.0, SIZE.1, |u, v| Luma([scale(ramp(u, v))])).into()),
        ("rgb8", ImageBuffer::from_fn(SIZE.0, SIZE.1, |u, v| Rgb([ramp(u, v); 3])).into()),
        ("rgb16", ImageBuffer::from_fn(SIZE.0, SIZE.1, |u, v| Rgb([scale(ramp(u, v)); 3])).into()),
        (
            "rgba8",
            ImageBuffer::from_fn(SIZE.0, SIZE.1, |u, v| {
                let grey = ramp(u, v);
                Rgba([grey, grey, grey, 9])
            })
            .into(),
        ),
        (
            "rgba16",
            ImageBuffer::from_fn(SIZE.0, SIZE.1, |u, v| {
                let grey = scale(ramp(u, v));
                Rgba([grey, grey, grey, 9])
            })
            .into(),
        ),
        ("greya8", ImageBuffer::from_fn(SIZE.0, SIZE.1, |u, v| LumaA([ramp(u, v), 9])).into()),
        ("greya16", ImageBuffer::from_fn(SIZE.0, SIZE.1, |u, v| LumaA([scale(ramp(u, v)), 9])).into()),
    ];
    let mut written = 0;
    for (kind, image) in images {
        for (ending, format) in
            [("png", ImageFormat::Png), ("tif", ImageFormat::Tiff), ("pnm", ImageFormat::Pnm)]
        {
            let path = folder.file(&format!("{kind}.{ending}"));
            // Not every format holds every kind of pixel.
            if image.save_with_format(&path, format).is_err() {
                continue;
            }
            written += 1;
            assert_eq!(grey(&path).unwrap(), ramp_image(), "{kind} {ending}");
        }
    }
    assert!(written >= 14, "only {written} files");
}

#[test]
fn a_jpeg_comes_as_nearly_the_same_grey_and_its_ending_does_not_matter() {
    let folder = Folder::new("jpeg");
    let image = ImageBuffer::from_fn(SIZE.0, SIZE.1, |u, v| Rgb([ramp(u, v); 3]));
    for name in ["a.jpg", "a.jpeg", "a.png"] {
        DynamicImage::from(image.clone()).save_with_format(folder.file(name), ImageFormat::Jpeg).unwrap();
        let read = grey(&folder.file(name)).unwrap();
        assert_eq!((read.width, read.height), SIZE);
        for (read, expected) in read.pixels.iter().zip(ramp_image().pixels) {
            assert!(read.abs_diff(expected) <= 24, "{read} {expected}");
        }
    }
}

#[test]
fn colours_count_by_their_luminance() {
    let folder = Folder::new("colours");
    let path = folder.file("colours.png");
    write_png_rgb(&path, 3, 1, &[255, 0, 0, 0, 255, 0, 0, 0, 255]).unwrap();
    // Rec. 709: 0.2126, 0.7152, 0.0722 of 255.
    assert_eq!(grey(&path).unwrap().pixels, [54, 182, 18]);
}

/// A binary PNM file of one row, and how it reads.
fn read_pnm(path: &Path, kind: &str, largest: u16, values: &[u16]) -> Vec<u8> {
    let pixels = values.len() / if kind == "P6" { 3 } else { 1 };
    let mut bytes = format!("{kind} {pixels} 1 {largest}\n").into_bytes();
    for value in values {
        let wide = value.to_be_bytes();
        bytes.extend(if largest > 255 { &wide[..] } else { &wide[1..] });
    }
    std::fs::write(path, bytes).unwrap();
    grey(path).unwrap().pixels
}

#[test]
fn wide_values_are_scaled_to_the_nearest_of_8_bit() {
    let folder = Folder::new("wide");
    let path = folder.file("wide.pgm");
    let nearest = |value: u16, largest: u16| (f64::from(value) * 255.0 / f64::from(largest)).round() as u8;
    // The whole 16 bits, cameras of 10 and 12 bits, and what the format allows besides.
    for (largest, step) in [(u16::MAX, 37), (4095, 1), (1023, 1), (256, 1), (200, 1), (15, 1)] {
        let values: Vec<u16> = (0..=largest).step_by(step).collect();
        let triples: Vec<u16> = values.iter().flat_map(|&value| [value; 3]).collect();
        for (kind, values_of_kind) in [("P5", &values), ("P6", &triples)] {
            let read = read_pnm(&path, kind, largest, values_of_kind);
            for (&read, &value) in read.iter().zip(&values) {
                let expected = nearest(value, largest);
                // By way of 16 bits: rounded twice.
                let twice = u8::from(largest != u16::MAX);
                assert!(read.abs_diff(expected) <= twice, "{value} of {largest}: {read}, not {expected}");
            }
        }
    }
}

#[test]
fn bitmaps_are_black_and_white() {
    let folder = Folder::new("bitmap");
    let path = folder.file("bitmap.pnm");
    std::fs::write(&path, b"P1 3 1\n1 0 1\n").unwrap();
    assert_eq!(grey(&path).unwrap().pixels, [0, 255, 0]);
    std::fs::write(&path, b"P4 3 1\n\xa0").unwrap();
    assert_eq!(grey(&path).unwrap().pixels, [0, 255, 0]);
}

#[test]
fn what_is_smaller_than_the_limits_is_refused() {
    let folder = Folder::new("small");
    let path = folder.file("small.pgm");
    std::fs::write(&path, b"P5 63 64 255\n").unwrap();
    let error = load_grey(&path, Limits { min_side: 64, ..Limits::default() }).unwrap_err().to_string();
    assert!(error.ends_with("is 63x64 pixels, each side must be 64 to 4096 pixels"), "{error}");
}

#[test]
fn what_is_written_reads_back() {
    let folder = Folder::new("write");
    let path = folder.file("grey.png");
    let image = ramp_image();
    write_png_grey(&path, image.width, image.height, &image.pixels).unwrap();
    assert_eq!(grey(&path).unwrap(), image);
    let nowhere = folder.file("no/grey.png");
    let error = write_png_grey(&nowhere, 1, 1, &[0]).unwrap_err().to_string();
    assert!(error.contains("no/grey.png: cannot be written: No such file"), "{error}");
}

#[test]
fn into_a_buffer_only_the_expected_size_is_loaded() {
    let folder = Folder::new("into");
    let path = folder.file("grey.png");
    let image = ramp_image();
    write_png_grey(&path, image.width, image.height, &image.pixels).unwrap();
    let mut buffer = vec![7; image.pixels.len()];
    load_grey_into(&path, &mut buffer, image.width, image.height).unwrap();
    assert_eq!(buffer, image.pixels);
    let mut turned = vec![7; image.pixels.len()];
    let error = load_grey_into(&path, &mut turned, image.height, image.width).unwrap_err();
    assert_eq!(error.to_string(), format!("{}: is 21x13 pixels, must be 13x21", path.display()));
    assert!(turned.iter().all(|&pixel| pixel == 7));
}

#[test]
fn broken_files_are_named_in_one_line() {
    let folder = Folder::new("broken");
    let bad = |name: &str, bytes: &[u8]| {
        std::fs::write(folder.file(name), bytes).unwrap();
        complaint(&folder.file(name))
    };
    assert!(bad("empty.png", b"").ends_with("is not a whole image: the file is empty"));
    bad("garbage.png", &[0x5a; 999]);
    bad("garbage.jpg", b"this is a text\nand no image\n");
    bad("none.pgm", b"P5 0 0 255\n");
    bad("short.pgm", b"P5 20 20 255\nxx");
    bad("words.pgm", b"P5 a b\n");
    bad("head.png", b"\x89PNG\r\n\x1a\n");
    bad("head.tif", b"II*\0\x08\0\0\0");
    bad("head.jpg", b"\xff\xd8\xff\xe0");
    assert!(complaint(&folder.file("missing.png")).contains("cannot be read: No such file"));
    std::fs::create_dir(folder.file("folder.png")).unwrap();
    complaint(&folder.file("folder.png"));
}

#[test]
fn an_image_beyond_the_limits_is_refused_before_it_is_decoded() {
    let folder = Folder::new("limits");
    let path = folder.file("wide.pgm");
    std::fs::write(&path, b"P5 5000 3 255\n").unwrap();
    assert_eq!(
        complaint(&path),
        format!("{}: is 5000x3 pixels, each side must be 1 to 4096 pixels", path.display())
    );
    std::fs::write(&path, b"P5 4294967295 4294967295 255\n").unwrap();
    complaint(&path);
    let image = ramp_image();
    write_png_grey(&path, image.width, image.height, &image.pixels).unwrap();
    let tight = Limits { max_bytes: 100, ..Limits::default() };
    let error = load_grey(&path, tight).unwrap_err().to_string();
    assert!(error.ends_with("takes 273 bytes to decode, at most 100 are allowed"), "{error}");
}

#[test]
fn truncated_and_mangled_files_give_an_error_or_an_image_but_never_a_panic() {
    let folder = Folder::new("mangled");
    let image: DynamicImage =
        ImageBuffer::from_fn(SIZE.0, SIZE.1, |u, v| Rgb([ramp(u, v), ramp(v, u), 3])).into();
    let path = folder.file("mangled.bin");
    for format in [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::Pnm, ImageFormat::Tiff] {
        let mut whole = std::io::Cursor::new(Vec::new());
        image.write_to(&mut whole, format).unwrap();
        let whole = whole.into_inner();
        for end in (0..whole.len()).step_by(11) {
            std::fs::write(&path, &whole[..end]).unwrap();
            let _ = grey(&path);
        }
        if format != ImageFormat::Jpeg {
            // A JPEG with a part missing at the end decodes to a grey part; what matters is the others'.
            std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
            complaint(&path);
        }
        let mut seed = 7_u32;
        for _ in 0..150 {
            let mut bytes = whole.clone();
            for _ in 0..4 {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let at = (seed >> 8) as usize % bytes.len();
                bytes[at] = seed as u8;
            }
            std::fs::write(&path, &bytes).unwrap();
            let _ = grey(&path);
        }
    }
}

#[test]
fn a_folder_lists_its_images_in_natural_order_and_nothing_else() {
    let folder = Folder::new("list");
    for name in
        ["f10.png", "f2.PNG", "f1.jpg", "f3.tiff", "f4.pgm", "meta.json", "png", ".hidden.png", "f0.txt"]
    {
        std::fs::write(folder.file(name), b"").unwrap();
    }
    std::fs::create_dir(folder.file("f5.png")).unwrap();
    std::os::unix::fs::symlink("nowhere", folder.file("f6.png")).unwrap();
    let names: Vec<_> =
        list(&folder.0).unwrap().iter().map(|path| path.file_name().unwrap().to_owned()).collect();
    assert_eq!(names, ["f1.jpg", "f2.PNG", "f3.tiff", "f4.pgm", "f6.png", "f10.png"]);
    complaint(&folder.file("f6.png"));
}

#[test]
fn a_folder_that_is_missing_or_a_file_is_named() {
    let folder = Folder::new("nofolder");
    let missing = folder.file("gone");
    assert_eq!(
        list(&missing).unwrap_err().to_string(),
        format!("{}: there is no such folder", missing.display())
    );
    std::fs::write(&missing, b"").unwrap();
    let error = list(&missing).unwrap_err().to_string();
    assert_eq!(error, format!("{}: is a file, give the folder that holds the images", missing.display()));
    assert!(list(&folder.file("gone/deeper")).unwrap_err().to_string().contains("is a file"));
}

#[test]
fn letters_stand_where_they_should_and_are_cut_off_outside() {
    let mut canvas = blank();
    canvas.text((2, 1), "1.", 1, RED);
    let one =
        [(4, 1), (3, 2), (4, 2), (4, 3), (4, 4), (4, 5), (4, 6), (9, 6), (10, 6), (3, 7), (4, 7), (5, 7)];
    assert_eq!(drawn(&canvas), [&one[..], &[(9, 7), (10, 7)]].concat());
    let (mut upper, mut lower) = (blank(), blank());
    upper.text((0, 0), "PX ", 1, RED);
    lower.text((0, 0), "px\u{20ac}", 1, RED);
    assert_eq!(upper, lower);
    let mut large = blank();
    large.text((-2, -2), "L", 2, RED);
    let left: Vec<_> = drawn(&large).into_iter().filter(|&(u, _)| u < 2).collect();
    assert!(left.is_empty() || left.iter().all(|&(_, v)| v >= 10 - 2), "only the foot is seen: {left:?}");
    assert_eq!(Canvas::text_size("10", 2), (22, 14));
    assert_eq!(Canvas::text_size("", 2), (0, 14));
}

#[test]
fn every_letter_has_a_shape_of_its_own() {
    let letters = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ.,-+/()=:%_";
    let mut seen = std::collections::BTreeSet::new();
    for letter in letters.chars() {
        let dots: Vec<_> = crate::letters::dots(letter).collect();
        assert!(!dots.is_empty() && dots.iter().all(|&(x, y)| x < 5 && y < 7), "{letter}");
        assert!(seen.insert(dots), "{letter}");
    }
}

#[test]
fn boxes_and_frames_fill_their_place_and_are_cut_off_outside() {
    let mut canvas = blank();
    canvas.fill((18, 8), (100, 100), RED);
    canvas.fill((-5, -5), (6, 6), RED);
    assert_eq!(drawn(&canvas), [(0, 0), (18, 8), (19, 8), (18, 9), (19, 9)]);
    let frame = GreyImage { width: 2, height: 2, pixels: vec![1, 2, 3, 4] };
    let mut canvas = Canvas::filled(3, 2, RED);
    canvas.place((2, -1), &frame);
    canvas.place((0, 1), &frame);
    let row = |v| [0, 1, 2].map(|u| canvas.colour_at(u, v).unwrap());
    assert_eq!(row(0), [RED, RED, [3; 3]]);
    assert_eq!(row(1), [[1; 3], [2; 3], RED]);
    assert_eq!((canvas.width(), canvas.height()), (3, 2));
}

#[test]
fn a_wide_pen_draws_wide_lines() {
    let mut canvas = blank().with_pen(3);
    canvas.line((5.0, 4.0), (7.0, 4.0), RED);
    let expected: Vec<_> = (3..=5).flat_map(|v| (4..=8).map(move |u| (u, v))).collect();
    assert_eq!(drawn(&canvas), expected);
}

const RED: [u8; 3] = [255, 0, 0];

fn blank() -> Canvas {
    Canvas::over(&GreyImage { width: 20, height: 10, pixels: vec![0; 200] })
}

fn drawn(canvas: &Canvas) -> Vec<(u32, u32)> {
    let all = (0..10).flat_map(|v| (0..20).map(move |u| (u, v)));
    all.filter(|&(u, v)| canvas.colour_at(u, v) == Some(RED)).collect()
}

#[test]
fn a_line_has_both_its_ends_and_no_gap() {
    let mut canvas = blank();
    canvas.line((2.0, 1.0), (6.0, 3.0), RED);
    assert_eq!(drawn(&canvas), [(2, 1), (3, 2), (4, 2), (5, 3), (6, 3)]);
    let mut back = blank();
    back.line((7.0, 7.0), (7.0, 4.0), RED);
    assert_eq!(drawn(&back), [(7, 4), (7, 5), (7, 6), (7, 7)]);
    let mut point = blank();
    point.line((3.4, 3.4), (3.4, 3.4), RED);
    assert_eq!(drawn(&point), [(3, 3)]);
}

#[test]
fn shapes_are_where_they_should_be() {
    let mut canvas = blank();
    canvas.cross((5.0, 5.0), 1.0, RED);
    assert_eq!(drawn(&canvas), [(5, 4), (4, 5), (5, 5), (6, 5), (5, 6)]);
    let mut canvas = blank();
    canvas.rectangle((1.0, 2.0), (3.0, 3.0), RED);
    assert_eq!(drawn(&canvas), [(1, 2), (2, 2), (3, 2), (1, 3), (3, 3), (1, 4), (2, 4), (3, 4)]);
    let mut canvas = blank();
    canvas.circle((10.0, 5.0), 4.0, RED);
    assert!(
        drawn(&canvas)
            .iter()
            .all(|&(u, v)| { ((f64::from(u) - 10.0).hypot(f64::from(v) - 5.0) - 4.0).abs() <= 0.6 })
    );
    assert!(drawn(&canvas).len() >= 20);
    let mut canvas = blank();
    canvas.arrow((2.0, 5.0), (10.0, 0.0), RED);
    let pixels = drawn(&canvas);
    assert!((2..=12).all(|u| pixels.contains(&(u, 5))));
    assert!(pixels.contains(&(9, 4)) || pixels.contains(&(9, 3)), "the head points back: {pixels:?}");
    let mut canvas = blank();
    canvas.arrow((2.0, 5.0), (0.3, 0.0), RED);
    assert!(drawn(&canvas).is_empty());
}

#[test]
fn what_lies_outside_is_cut_off_and_what_is_not_finite_is_not_drawn() {
    let mut canvas = blank();
    canvas.line((-1e9, 5.0), (1e9, 5.0), RED);
    assert_eq!(drawn(&canvas), (0..20).map(|u| (u, 5)).collect::<Vec<_>>());
    let mut canvas = blank();
    canvas.line((-5.0, -5.0), (40.0, 40.0), RED);
    assert_eq!(drawn(&canvas), (0..10).map(|i| (i, i)).collect::<Vec<_>>());
    let mut canvas = blank();
    for bad in [f64::NAN, f64::INFINITY, -1e308, 1e300] {
        canvas.line((bad, 1.0), (bad, 3.0), RED);
        canvas.line((-bad, bad), (bad, 100.0), RED);
        canvas.cross((bad, 4.0), 3.0, RED);
        canvas.circle((bad, 4.0), 3.0, RED);
        canvas.circle((50.0, 50.0), bad, RED);
        canvas.arrow((50.0, 50.0), (bad, bad), RED);
        canvas.rectangle((bad, bad), (2.0, 2.0), RED);
    }
    assert!(drawn(&canvas).is_empty());
    canvas.circle((0.0, 0.0), 3.0, RED);
    canvas.rectangle((-3.0, -3.0), (100.0, 100.0), RED);
}
