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
        format!("{}: is 5000x3 pixels, at most 4096x4096 are allowed", path.display())
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
