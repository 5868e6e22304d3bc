use std::f64::consts::PI;
use std::path::{Path, PathBuf};

use crate::{Checker, Document, Faults, Scope};

#[derive(Clone, Copy, Debug, PartialEq)]
enum Mode {
    Paper,
    Robust,
}

const MODES: &[(&str, Mode)] = &[("paper", Mode::Paper), ("robust", Mode::Robust)];

/// What a reader of the sections below gets.
#[derive(Debug, PartialEq)]
struct Settings {
    rate_hz: f64,
    width_px: u32,
    gain: f64,
    frames: PathBuf,
    mode: Mode,
    levels: usize,
    symmetric: bool,
    home_rad: Vec<f64>,
    name: String,
}

fn check(document: &Document, scope: Scope) -> Result<Settings, Faults> {
    let checker = Checker::new(document);
    let camera = checker.section("camera");
    let vision = checker.section("vision");
    let arm = checker.section("arm");
    let service = checker.section("services.vision");
    let settings = Settings {
        rate_hz: camera.float("rate_hz", 0.1..=1000.0),
        width_px: camera.integer_or("width_px", 64..=4096, 512),
        gain: camera.float_or("gain", 0.0.., 1.0),
        frames: camera.path_or("frames", "frames"),
        mode: vision.choice_or("mode", MODES, Mode::Paper),
        levels: vision.integer_or("pyramid_levels", 1..=6, 3),
        symmetric: vision.flag_or("symmetric", false),
        home_rad: arm.floats_or("home_rad", 2, -PI..=PI, &[0.0, 0.6]),
        name: service.text_or("name", "vision"),
    };
    if camera.has("width_px") && !settings.width_px.is_multiple_of(16) {
        camera.fault("width_px", format_args!("is {}, must be a multiple of 16", settings.width_px));
    }
    checker.finish(scope).map(|()| settings)
}

fn faults(text: &str) -> Vec<String> {
    let result = Document::parse("config/sim.toml", text).and_then(|document| check(&document, Scope::All));
    result.unwrap_err().iter().map(ToString::to_string).collect()
}

/// A bad file below a good first part, and its one fault.
const BAD_CAMERA: &[(&str, &str)] = &[
    // Out of range.
    ("rate_hz = 5000", "2: camera.rate_hz is 5000, must be between 0.1 and 1000"),
    ("rate_hz = 0.0999", "2: camera.rate_hz is 0.0999, must be between 0.1 and 1000"),
    ("rate_hz = -25", "2: camera.rate_hz is -25, must be between 0.1 and 1000"),
    ("rate_hz = 1e300", "2: camera.rate_hz is 1e300, must be between 0.1 and 1000"),
    ("rate_hz = 25\n\n\nwidth_px = 32", "5: camera.width_px is 32, must be between 64 and 4096"),
    ("rate_hz = 25\nwidth_px = -64", "3: camera.width_px is -64, must be between 64 and 4096"),
    (
        "rate_hz = 25\nwidth_px = 0x7fffffffffff",
        "3: camera.width_px is 140737488355327, must be between 64 and 4096",
    ),
    ("rate_hz = 25\ngain = -0.5", "3: camera.gain is -0.5, must be at least 0"),
    // Not finite, or not a number that fits.
    ("rate_hz = nan", "2: camera.rate_hz is nan, must be a finite number"),
    ("rate_hz = inf", "2: camera.rate_hz is inf, must be a finite number"),
    ("rate_hz = 25\ngain = +inf", "3: camera.gain is +inf, must be a finite number"),
    ("rate_hz = 25\ngain = -nan", "3: camera.gain is -nan, must be a finite number"),
    ("rate_hz = 1e999", "2: camera.rate_hz is 1e999, must be a finite number"),
    (
        "rate_hz = 99999999999999999999",
        "2: camera.rate_hz is 99999999999999999999, which is beyond the 64 bits of a whole number",
    ),
    // Wrong type.
    ("rate_hz = \"25\"", "2: camera.rate_hz is the text \"25\", must be a number between 0.1 and 1000"),
    ("rate_hz = true", "2: camera.rate_hz is true, must be a number between 0.1 and 1000"),
    ("rate_hz = [25]", "2: camera.rate_hz is a list of 1, must be a number between 0.1 and 1000"),
    ("rate_hz = {a = 1}", "2: camera.rate_hz is a section, must be a number between 0.1 and 1000"),
    ("rate_hz.x = 3", "2: camera.rate_hz is a section, must be a number between 0.1 and 1000"),
    (
        "rate_hz = 2020-01-02",
        "2: camera.rate_hz is the date 2020-01-02, must be a number between 0.1 and 1000",
    ),
    (
        "rate_hz = 25\nwidth_px = 512.0",
        "3: camera.width_px is 512.0, must be a whole number between 64 and 4096",
    ),
    (
        "rate_hz = 25\nwidth_px = '''5\n12'''",
        "3: camera.width_px is the text \"5\\n12\", must be a whole number between 64 and 4096",
    ),
    ("rate_hz = 25\nframes = 3", "3: camera.frames is 3, must be a path in quotes"),
    ("rate_hz = 25\nframes = ''", "3: camera.frames is the text \"\", must be a path in quotes"),
    (
        "rate_hz = 25\n[vision]\nsymmetric = 1",
        "4: vision.symmetric is 1, must be true or false (without quotes)",
    ),
    (
        "rate_hz = 25\n[vision]\nsymmetric = 'true'",
        "4: vision.symmetric is the text \"true\", must be true or false (without quotes)",
    ),
    ("rate_hz = 25\n[services.vision]\nname = 7", "4: services.vision.name is 7, must be a text in quotes"),
    // Lists.
    (
        "rate_hz = 25\n[arm]\nhome_rad = [0.1]",
        "4: arm.home_rad is a list of 1, must be a list of 2 numbers between -3.141592653589793 and 3.141592653589793",
    ),
    ("rate_hz = 25\n[arm]\nhome_rad = [\n0.1,\n7,\n]", "6: arm.home_rad is 7, must be between"),
    (
        "rate_hz = 25\n[arm]\nhome_rad = [0.1,\n'b']",
        "5: arm.home_rad is the text \"b\", must be a number between",
    ),
    ("rate_hz = 25\n[arm]\nhome_rad = [0.1,\nnan]", "5: arm.home_rad is nan, must be a finite number"),
    ("rate_hz = 25\n[arm]\nhome_rad = 0.1", "4: arm.home_rad is 0.1, must be a list of 2 numbers"),
    // Choices.
    ("rate_hz = 25\n[vision]\nmode = 3", "4: vision.mode is 3, must be one of \"paper\", \"robust\""),
    (
        "rate_hz = 25\n[vision]\nmode = 'fast'",
        "4: vision.mode is the text \"fast\", must be one of \"paper\", \"robust\"",
    ),
    (
        "rate_hz = 25\n[vision]\nmode = 'papper'",
        "4: vision.mode is the text \"papper\", must be one of \"paper\", \"robust\" (did you mean \"paper\"?)",
    ),
    // Unknown and missing.
    ("rate_hz = 25\nwitdh_px = 64", "3: camera.witdh_px is not a key of [camera], did you mean width_px?"),
    ("rate_hz = 25\nwidth = 64", "3: camera.width is not a key of [camera], did you mean width_px?"),
    (
        "rate_hz = 25\nmode = 'paper'",
        "3: camera.mode is not a key of [camera], but of [vision]; move it there",
    ),
    (
        "rate_hz = 25\ncolour = 1",
        "3: camera.colour is not a key of [camera]; its keys are rate_hz, width_px, gain, frames",
    ),
    (
        "",
        "1: camera.rate_hz is missing, must be a number between 0.1 and 1000; add rate_hz = … below [camera]",
    ),
    ("rate_hz = 25\n[vison]\nmode = 'paper'", "3: vison is not a section, did you mean [vision]?"),
    (
        "rate_hz = 25\n[dashboard]",
        "3: dashboard is not a section; there are arm, camera, services.vision, vision",
    ),
    (
        "rate_hz = 25\n[services.visoin]",
        "3: services.visoin is not a section, did you mean [services.vision]?",
    ),
    (
        "rate_hz = 25\n[services]\nx = 1",
        "4: services.x is not a key: [services] holds only sections; remove it",
    ),
    (
        "rate_hz = 25\n[[vision]]\nmode = 'paper'",
        "3: vision is a list, must be a section; write [vision] once",
    ),
    ("rate_hz = 25\n\"wi dth\" = 3", "3: \"camera.wi dth\" is no key of a configuration"),
    // What only the caller can see.
    ("rate_hz = 25\nwidth_px = 500", "3: camera.width_px is 500, must be a multiple of 16"),
    // Not TOML.
    ("rate_hz = 25\nrate_hz = 26", "3: camera.rate_hz is set twice; remove one"),
    (
        "rate_hz = 25\n[vision]\n[camera]",
        "4: the section [camera] is there twice, or is a key already; write it once",
    ),
    ("rate_hz = fast", "2: camera.rate_hz is fast, which is not TOML; a text needs quotes: \"fast\""),
    ("rate_hz =", "2: camera.rate_hz has no value"),
    ("rate_hz 25", "2: camera.rate_hz is not TOML: key with no value, expected `=`"),
    ("rate_hz = 1__0", "2: camera.rate_hz is not TOML: `_` may only go between digits"),
    ("rate_hz = 25\nframes = 'a", "3: camera.frames is not TOML: invalid literal string"),
    ("rate_hz = 25\nframes = \"\\q\"", "3: camera.frames is not TOML: missing escaped value"),
    ("rate_hz = 25\n[vision\nmode = 'paper'", "3: [vision] is not TOML: unclosed table, expected `]`"),
    ("rate_hz = 25\n[vision]\nmode = tru", "4: vision.mode is"),
    ("rate_hz = 25 width_px = 64", "2: camera.rate_hz is"),
];

#[test]
fn each_bad_file_gives_its_one_fault_with_file_line_and_key() {
    for (text, expected) in BAD_CAMERA {
        let found = faults(&format!("[camera]\n{text}"));
        assert_eq!(found.len(), 1, "{text:?} gave {found:#?}");
        let expected = format!("config/sim.toml:{expected}");
        assert!(found[0].starts_with(&expected), "{text:?} gave\n  {}\nnot\n  {expected}", found[0]);
        assert!(!found[0].contains('\n'), "{text:?} gave more than a line");
    }
    assert!(BAD_CAMERA.len() >= 40);
}

#[test]
fn all_faults_come_at_once_in_the_order_of_the_file() {
    let text = "stray = 1\n[vision]\nmode = 'x'\nlevels = 3\n[camera]\ngain = -1\nwidth_px = 65\n[extra]\n";
    assert_eq!(
        faults(text),
        [
            "config/sim.toml:1: stray stands before the first section and is not a key; remove it",
            "config/sim.toml:3: vision.mode is the text \"x\", must be one of \"paper\", \"robust\"",
            "config/sim.toml:4: vision.levels is not a key of [vision]; its keys are mode, pyramid_levels, symmetric",
            "config/sim.toml:5: camera.rate_hz is missing, must be a number between 0.1 and 1000; add rate_hz = … below [camera]",
            "config/sim.toml:6: camera.gain is -1, must be at least 0",
            "config/sim.toml:7: camera.width_px is 65, must be a multiple of 16",
            "config/sim.toml:8: extra is not a section; there are arm, camera, services.vision, vision",
        ]
    );
}

#[test]
fn several_syntax_errors_come_at_once() {
    let found = faults("[camera]\nrate_hz = fast\nrate_hz = 1\nframes = 'x\n[arm]\nhome_rad = [1, 2\n");
    let lines: Vec<&str> = found.iter().map(|fault| fault.split(' ').next().unwrap()).collect();
    assert_eq!(lines[..3], ["config/sim.toml:2:", "config/sim.toml:3:", "config/sim.toml:4:"], "{found:#?}");
    assert!(lines.len() >= 4, "{found:#?}");
}

#[test]
fn an_empty_file_names_the_section_that_is_missing() {
    for text in ["", "# nothing\n", "[vision]\n"] {
        let found = faults(text);
        assert_eq!(found.len(), 1);
        assert!(found[0].starts_with("config/sim.toml:1: camera.rate_hz is missing"), "{found:?}");
        assert!(found[0].ends_with("add a section [camera] with rate_hz = …"), "{found:?}");
    }
}

const GOOD: &str = "# The whole of it.\n[camera]\nrate_hz = 25\nframes = \"../frames\"\ngain = 2.5 # half of it\n\
    [arm]\nhome_rad = [0, -0.5]\n[vision]\nmode = 'robust'\nsymmetric = true\n[services.vision]\nname = \"a\\\"b\\nc\"\n";

#[test]
fn a_good_file_gives_its_values_and_the_defaults() {
    let document = Document::parse("config/sim.toml", GOOD).unwrap();
    let settings = check(&document, Scope::All).unwrap();
    let expected = Settings {
        rate_hz: 25.0,
        width_px: 512,
        gain: 2.5,
        frames: PathBuf::from("config/../frames"),
        mode: Mode::Robust,
        levels: 3,
        symmetric: true,
        home_rad: vec![0.0, -0.5],
        name: "a\"b\nc".to_owned(),
    };
    assert_eq!(settings, expected);
}

#[test]
fn a_service_that_reads_its_section_only_does_not_judge_the_others() {
    let text = "stray = 1\n[camera]\nrate_hz = 25\n[vision]\nmode = 'x'\n[camera.lens]\nk = 1\n";
    let document = Document::parse("sim.toml", text).unwrap();
    let read = |scope| {
        let checker = Checker::new(&document);
        checker.section("camera").float("rate_hz", 0.1..=1000.0);
        checker.finish(scope)
    };
    assert_eq!(read(Scope::ReadSections), Ok(()));
    assert_eq!(read(Scope::All).unwrap_err().iter().count(), 3);
    let text = text.replace("rate_hz = 25", "rate_hz = 25\nrat_hz = 3");
    let document = Document::parse("sim.toml", &text).unwrap();
    let checker = Checker::new(&document);
    checker.section("camera").float("rate_hz", 0.1..=1000.0);
    assert!(checker.finish(Scope::ReadSections).unwrap_err().to_string().contains("did you mean rate_hz?"));
}

#[test]
fn overrides_replace_and_add_values_and_are_named_in_faults() {
    let mut document = Document::parse("config/sim.toml", GOOD).unwrap();
    for (key, value) in [
        ("camera.rate_hz", "50"),
        ("camera.rate_hz", "12.5"),
        ("vision.mode", "paper"),
        ("arm.home_rad", "[0.25, 1]"),
        ("camera.frames", "/data/run 7"),
        ("services.vision.name", "'eye'"),
        ("vision.symmetric", " false "),
    ] {
        document.set(key, value).unwrap();
    }
    let settings = check(&document, Scope::All).unwrap();
    assert_eq!((settings.rate_hz, settings.mode, settings.symmetric), (12.5, Mode::Paper, false));
    assert_eq!(settings.home_rad, [0.25, 1.0]);
    assert_eq!((settings.frames, settings.name.as_str()), (PathBuf::from("/data/run 7"), "eye"));

    document.set("camera.rate_hz", "5000").unwrap();
    document.set("vision.levels", "3").unwrap();
    document.set("vision.pyramid_levels", "three").unwrap();
    let found = check(&document, Scope::All).unwrap_err().to_string();
    assert_eq!(
        found.lines().collect::<Vec<_>>(),
        [
            "--set camera.rate_hz: camera.rate_hz is 5000, must be between 0.1 and 1000",
            "--set vision.levels: vision.levels is not a key of [vision]; its keys are mode, pyramid_levels, symmetric",
            "--set vision.pyramid_levels: vision.pyramid_levels is the text \"three\", must be a whole number between 1 and 6",
        ]
    );
}

#[test]
fn an_override_into_a_file_without_that_section_adds_it() {
    let mut document = Document::parse("sim.toml", "").unwrap();
    document.set("camera.rate_hz", "30").unwrap();
    document.set("services.vision.name", "eye").unwrap();
    let settings = check(&document, Scope::All).unwrap();
    assert_eq!((settings.rate_hz, settings.name.as_str()), (30.0, "eye"));
    document.set("nowhere.x", "1").unwrap();
    let found = check(&document, Scope::All).unwrap_err().to_string();
    assert_eq!(
        found,
        "--set nowhere.x: nowhere is not a section; there are arm, camera, services.vision, vision"
    );
}

#[test]
fn an_override_that_cannot_be_is_refused_at_once() {
    let mut document = Document::parse("sim.toml", GOOD).unwrap();
    let before = document.to_toml();
    for (key, value, message) in [
        ("rate_hz", "3", "\"rate_hz\" names no section, write section.key=value"),
        ("", "3", "\"\" names no section, write section.key=value"),
        ("camera.", "3", "\"camera.\" is not a key, write section.key=value"),
        ("camera.ra te", "3", "\"camera.ra te\" is not a key, write section.key=value"),
        ("camera.rate_hz", "", "camera.rate_hz has no value; for an empty text write camera.rate_hz='\"\"'"),
        ("camera.rate_hz", "nan", "camera.rate_hz is nan, must be a finite number"),
        ("arm.home_rad", "[1, inf]", "arm.home_rad is inf, must be a finite number"),
        ("arm.home_rad", "[1, 2", "arm.home_rad is [1, 2, which is not TOML: unclosed array, expected `]`"),
        ("services.vision", "3", "services.vision is a whole section, set one of its keys"),
        ("camera.rate_hz.x", "3", "camera.rate_hz.x cannot be set: rate_hz is 25, not a section"),
    ] {
        let fault = document.set(key, value).unwrap_err().to_string();
        assert_eq!(fault, format!("--set {key}: {message}"));
    }
    assert_eq!(document.to_toml(), before);
}

#[test]
fn the_effective_configuration_reads_back_as_the_same() {
    let mut document = Document::parse("config/sim.toml", GOOD).unwrap();
    document.set("vision.pyramid_levels", "4").unwrap();
    document.set("camera.gain", "0.1").unwrap();
    document.set("extra.odd", "[[1, '''a\nb'''], {k = 1979-05-27, l = [true]}]").unwrap();
    let written = document.to_toml();
    let read = Document::parse("config/sim.toml", &written).unwrap();
    assert_eq!(read.to_toml(), written);
    assert_eq!(check(&read, Scope::ReadSections), check(&document, Scope::ReadSections));
    assert!(
        written.starts_with("[camera]\nrate_hz = 25\nframes = \"../frames\"\ngain = 0.1\n\n[arm]\n"),
        "{written}"
    );
    for text in ["", "[a]\nx = [[1]]\n[[b]]\ny = 1\n[[b]]\ny = 2\n[a.c.d]\nz = {q = 1}\n", "a.b.c = 1e-300\n"]
    {
        let written = Document::parse("x", text).unwrap().to_toml();
        assert_eq!(Document::parse("x", &written).unwrap().to_toml(), written, "{text}");
    }
}

#[test]
fn relative_paths_are_relative_to_the_folder_of_the_file_or_the_one_that_is_set() {
    let mut document = Document::parse("/etc/pursuit/sim.toml", "[camera]\nrate_hz = 1\n").unwrap();
    assert_eq!(check(&document, Scope::All).unwrap().frames, Path::new("/etc/pursuit/frames"));
    document.set_folder(Path::new("/srv"));
    assert_eq!(check(&document, Scope::All).unwrap().frames, Path::new("/srv/frames"));
}

#[test]
fn files_that_cannot_be_read_are_named() {
    let missing = Document::load(Path::new("/nonexistent/sim.toml")).unwrap_err().to_string();
    assert!(missing.starts_with("/nonexistent/sim.toml: cannot be read: No such file"), "{missing}");
    let folder = std::env::temp_dir().join(format!("pursuit-config-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let of_folder = Document::load(&folder).unwrap_err().to_string();
    assert!(of_folder.contains("cannot be read: "), "{of_folder}");
    let file = folder.join("sim.toml");
    std::fs::write(&file, b"[camera]\nrate_hz = 25\nname = \"\xff\"\n").unwrap();
    let binary = Document::load(&file).unwrap_err().to_string();
    assert!(binary.ends_with("sim.toml:3: is not UTF-8 text; save the file as UTF-8"), "{binary}");
    std::fs::write(&file, vec![b'#'; (1 << 20) + 1]).unwrap();
    assert!(Document::load(&file).unwrap_err().to_string().contains("larger than 1 MiB"));
    std::fs::write(&file, GOOD).unwrap();
    assert!(check(&Document::load(&file).unwrap(), Scope::All).is_ok());
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn after_a_fault_reading_goes_on_with_a_value_in_range() {
    let document = Document::parse("sim.toml", "[a]\nf = 'x'\nd = 9.0\n").unwrap();
    let checker = Checker::new(&document);
    let section = checker.section("a");
    assert_eq!(section.float("f", 0.5..=2.0), 0.5);
    assert_eq!(section.float_or("d", 0.5..=2.0, 1.25), 1.25);
    assert_eq!(section.float("gone", ..=-2.0), -2.0);
    assert_eq!(section.integer::<u8>("gone", 3..), 3);
    assert_eq!(section.floats("gone", 2, ..), [0.0, 0.0]);
    assert_eq!(section.choice("gone", MODES), Mode::Paper);
    assert_eq!((section.text("gone"), section.flag("gone")), (String::new(), false));
    assert!(checker.finish(Scope::All).is_err());
}

#[test]
fn mangled_texts_never_panic() {
    let mut seed = 1_u32;
    for _ in 0..3000 {
        let mut bytes = GOOD.as_bytes().to_vec();
        for _ in 0..3 {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let at = seed as usize / 7 % bytes.len();
            match seed >> 30 {
                0 => drop(bytes.remove(at)),
                1 => bytes[at] = b"[]{}='\"\n.\\#\xc3\xa91"[seed as usize / 64 % 14],
                2 => bytes.truncate(at.max(1)),
                _ => bytes.insert(at, b"[]{}='\"\n.\\#,-_"[seed as usize / 64 % 14]),
            }
        }
        let text = String::from_utf8_lossy(&bytes);
        match Document::parse("sim.toml", &text).and_then(|document| check(&document, Scope::All)) {
            Ok(_) => {}
            Err(faults) => {
                assert!(
                    faults.to_string().lines().all(|line| line.starts_with("sim.toml:")),
                    "{text}\n{faults}"
                );
            }
        }
    }
}

#[test]
fn who_reads_some_keys_of_a_shared_section_is_told_of_those_alone() {
    let document = Document::parse("t.toml", "[camera]\nrate_hz = 25\nother = 1\nwidth = 9\n").unwrap();
    let checker = Checker::new(&document);
    assert_eq!(checker.section("camera").float("rate_hz", 0.0..=100.0), 25.0);
    assert!(checker.finish(Scope::ReadKeys).is_ok());
    let checker = Checker::new(&document);
    checker.section("camera").integer::<u32>("width", 10..=20);
    assert_eq!(checker.finish(Scope::ReadKeys).unwrap_err().iter().count(), 1);
}
