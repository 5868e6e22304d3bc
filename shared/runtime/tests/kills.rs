//! 500 writers killed at any instant: never half a state, never a committed one lost.

#![allow(clippy::unwrap_used)]

use pursuit_runtime::checkpoint::Checkpoint;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const FILE: &str = "PURSUIT_TEST_CHECKPOINT";
const KILLS: u64 = 500;
const CAPACITY: usize = 16_384;

/// State number `n`: its number, then as many bytes as it says, all from the number.
fn state(n: u64, buffer: &mut Vec<u8>) {
    buffer.extend_from_slice(&n.to_le_bytes());
    buffer.resize(8 + (n * 997 % 12_000) as usize, (n % 251) as u8);
}

fn number(bytes: &[u8]) -> u64 {
    let n = u64::from_le_bytes(bytes[..8].try_into().unwrap());
    let mut whole = Vec::new();
    state(n, &mut whole);
    assert!(bytes == whole, "half a state of number {n}");
    n
}

/// The process that is killed: commits for ever and says so after each commit, on standard error.
#[test]
fn writer() {
    let Some(file) = std::env::var_os(FILE) else { return };
    let (mut checkpoint, before) = Checkpoint::open(Path::new(&file), 7, CAPACITY).unwrap();
    let mut n = before.map_or(0, |bytes| number(&bytes));
    let mut said = std::io::stderr().lock();
    loop {
        n += 1;
        checkpoint.save(|buffer| state(n, buffer)).unwrap();
        if said.write_all(&n.to_le_bytes()).is_err() {
            return;
        }
    }
}

struct Scratch(PathBuf);

impl Drop for Scratch {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

#[test]
fn a_killed_writer_leaves_the_last_committed_state_or_the_one_in_flight() {
    let file = Scratch(std::env::temp_dir().join(format!("pursuit-kills-{}", std::process::id())));
    let mut before = 0;
    for round in 0..KILLS {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["writer", "--exact"])
            .env(FILE, &file.0)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = child.stderr.take().unwrap();
        // Another number of commits each time, and another moment within the next.
        let mut heard = vec![0; 8 * (1 + (round * 7 % 23) as usize)];
        said.read_exact(&mut heard).unwrap();
        for _ in 0..round * 131 % 5_000 {
            std::hint::spin_loop();
        }
        child.kill().unwrap();
        child.wait().unwrap();
        said.read_to_end(&mut heard).unwrap();
        let whole = heard.len() / 8 * 8;
        let committed = u64::from_le_bytes(heard[whole - 8..whole].try_into().unwrap());
        let (_, found) = Checkpoint::open(&file.0, 7, CAPACITY).unwrap();
        let found = number(&found.expect("a state is there"));
        assert!(
            found == committed || found == committed + 1,
            "round {round}: {found}, {committed} committed"
        );
        assert!(found > before, "round {round} went on from before");
        before = found;
    }
}
