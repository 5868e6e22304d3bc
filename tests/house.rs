//! House rules that a reader relies on: who may know what, how long a file may be, documents that are true.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

fn sources_below(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            found.extend(sources_below(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
    found
}

/// Crates of the workspace: folder and manifest.
fn crates() -> Vec<(String, String)> {
    let mut found = Vec::new();
    for group in ["services", "shared"] {
        for entry in std::fs::read_dir(root().join(group)).expect("the group's folder").flatten() {
            if entry.path().join("Cargo.toml").exists() {
                let name = format!("{group}/{}", entry.file_name().to_string_lossy());
                let manifest = read(&format!("{name}/Cargo.toml"));
                found.push((name, manifest));
            }
        }
    }
    assert!(found.len() > 10, "the workspace has its crates");
    found
}

/// The part of a manifest that ships: without dev-dependencies.
fn shipped(manifest: &str) -> &str {
    manifest.split("[dev-dependencies]").next().unwrap_or(manifest)
}

#[test]
fn each_library_is_known_only_where_it_belongs() {
    let allowed: [(&str, &[&str]); 6] = [
        ("iceoryx2", &["shared/bus", "shared/messages"]),
        ("rapier3d", &["shared/world"]),
        ("image", &["shared/images"]),
        ("toml", &["shared/config"]),
        ("tokio", &["services/observer", "services/supervisor"]),
        ("nalgebra", &["shared/kinematics", "shared/motion", "shared/world"]),
    ];
    for (name, manifest) in crates() {
        for (library, homes) in allowed {
            let knows = shipped(&manifest).lines().any(|line| line.starts_with(&format!("{library}.")));
            assert!(!knows || homes.contains(&name.as_str()), "{name} must not know {library}");
        }
    }
}

#[test]
fn pure_crates_know_no_clock_file_log_bus_or_thread() {
    let forbidden =
        ["std::time::Instant", "SystemTime", "std::fs", "std::net", "std::thread", "tracing", "println!"];
    for name in ["motion", "learning", "kinematics", "scene", "world"] {
        let manifest = read(&format!("shared/{name}/Cargo.toml"));
        for other in ["pursuit-bus", "pursuit-runtime", "pursuit-messages", "tracing"] {
            assert!(!shipped(&manifest).contains(other), "shared/{name} must not depend on {other}");
        }
        for path in sources_below(&root().join(format!("shared/{name}/src"))) {
            let text = std::fs::read_to_string(&path).expect("a source file");
            // Tests may do what they want.
            let code = text.split("#[cfg(test)]").next().unwrap_or(&text);
            if path.components().any(|part| part.as_os_str() == "tests" || part.as_os_str() == "tests.rs") {
                continue;
            }
            for word in forbidden {
                assert!(!code.contains(word), "{} uses {word}", path.display());
            }
        }
    }
}

#[test]
fn no_service_names_another() {
    let services: Vec<String> =
        crates().into_iter().map(|c| c.0).filter(|n| n.starts_with("services/")).collect();
    for (name, manifest) in crates() {
        for service in &services {
            let package = format!("pursuit-{}", service.trim_start_matches("services/"));
            let names_it = manifest.lines().any(|line| line.starts_with(&format!("{package}.")));
            assert!(!names_it, "{name} must not depend on {package}");
        }
    }
}

#[test]
fn files_stay_short_enough_to_be_read() {
    for group in ["services", "shared"] {
        for path in sources_below(&root().join(group)) {
            if path
                .components()
                .any(|part| ["tests", "tests.rs", "benches"].iter().any(|t| part.as_os_str() == *t))
            {
                continue;
            }
            let text = std::fs::read_to_string(&path).expect("a source file");
            let code = text.split("#[cfg(test)]").next().unwrap_or(&text).lines().count();
            assert!(code <= 500, "{} has {code} lines: one idea per file", path.display());
        }
    }
}

#[test]
fn architecture_names_every_crate_and_every_topic() {
    let architecture = read("ARCHITECTURE.md");
    for (name, _) in crates() {
        assert!(architecture.contains(&name), "ARCHITECTURE.md does not name {name}");
    }
    let topics = read("shared/messages/src/topics.rs");
    for line in topics.lines().filter(|line| line.starts_with("//! | ") && line.contains(" | ")) {
        let topic = line.trim_start_matches("//! | ").split(' ').next().unwrap_or_default();
        if topic != "topic" {
            assert!(architecture.contains(topic), "ARCHITECTURE.md does not name the topic {topic}");
        }
    }
}

#[test]
fn documents_name_only_what_exists() {
    for document in ["README.md", "ARCHITECTURE.md"] {
        let text = read(document);
        for word in text.split(|c: char| c.is_whitespace() || "`()[]|,;".contains(c)) {
            let word = word.trim_end_matches(['.', ':']);
            let looks_like_a_path =
                ["services/", "shared/", "config/", "tests/", "ops/"].iter().any(|p| word.starts_with(p));
            if looks_like_a_path && !word.contains('*') && !word.contains('…') {
                assert!(root().join(word).exists(), "{document} names {word}, which does not exist");
            }
        }
    }
}

#[test]
fn readme_s_first_screen_has_the_two_commands() {
    let first: String = read("README.md").lines().take(40).collect::<Vec<_>>().join("\n");
    assert!(first.contains("cargo run --release") && first.contains("cargo test"));
}

#[test]
fn every_verb_is_in_the_readme() {
    let readme = read("README.md");
    for verb in [
        "demo",
        "up",
        "run",
        "status",
        "top",
        "trace",
        "why",
        "restart",
        "down",
        "record",
        "replay",
        "report",
        "detect",
        "experiment",
        "chaos",
        "doctor",
        "check",
    ] {
        assert!(readme.contains(&format!("pursuit {verb}")), "README.md does not show `pursuit {verb}`");
    }
}

#[test]
fn every_config_key_that_is_read_stands_in_sim_toml_with_a_comment() {
    let sim = read("config/sim.toml");
    let mut keys = BTreeSet::new();
    for folder in ["services", "shared/runtime/src"] {
        for path in sources_below(&root().join(folder)) {
            let text = std::fs::read_to_string(&path).expect("a source file");
            for reader in ["float", "integer", "flag", "text", "path", "floats", "choice"] {
                for call in [format!(".{reader}_or("), format!(".{reader}(")] {
                    for rest in text.split(&call).skip(1) {
                        if let Some(key) =
                            rest.trim_start().strip_prefix('"').and_then(|r| r.split('"').next())
                        {
                            keys.insert(key.to_owned());
                        }
                    }
                }
            }
        }
    }
    assert!(keys.len() > 30, "the search finds the keys: {keys:?}");
    for key in keys.iter().filter(|key| !key.contains(['-', ' ', '/', '.'])) {
        let line = sim.lines().find(|line| {
            let line = line.trim_start_matches("# ");
            line.split(" = ").next() == Some(key)
        });
        let line = line.unwrap_or_else(|| panic!("config/sim.toml has no key {key}"));
        assert!(line.matches('#').count() >= 1, "config/sim.toml says nothing about {key}");
    }
}
