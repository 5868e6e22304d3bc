//! Shared memory that is full: a sentence for whoever starts something, and a run that goes on.

mod support;

use rustix::process::Signal;
use std::process::{Child, Command, Stdio};
use support::{Place, System, kill, pid_of, text, wait_for};

/// A /dev/shm of its own, which nobody else sees; it is gone with the process that holds it.
struct Memory(Child);

impl Memory {
    /// Nothing, said on the error output, where this machine gives a user no name spaces.
    fn of(megabytes: u32) -> Option<Memory> {
        let script =
            format!("mount -t tmpfs -o size={megabytes}m none /dev/shm && echo there && exec sleep 1000");
        let mut command = Command::new("unshare");
        command.args(["-Urm", "sh", "-c", &script]).stdin(Stdio::null()).stdout(Stdio::piped());
        let started = command.spawn();
        let mut memory = match started {
            Ok(child) => Memory(child),
            Err(error) => {
                eprintln!("skipped: unshare: {error} (Debian: util-linux)");
                return None;
            }
        };
        let mut line = String::new();
        let out = memory.0.stdout.take().expect("piped");
        let _ = std::io::BufRead::read_line(&mut std::io::BufReader::new(out), &mut line);
        if line.trim() != "there" {
            eprintln!("skipped: no user name spaces here");
            return None;
        }
        Some(memory)
    }

    /// The command, inside.
    fn inside(&self, command: &Command) -> Command {
        let mut inside = Command::new("nsenter");
        let pid = self.0.id().to_string();
        inside.args(["-t", &pid, "-U", "-m", "--preserve-credentials"]).arg(command.get_program());
        inside.args(command.get_args());
        for (key, value) in command.get_envs() {
            inside.env(key, value.unwrap_or_default());
        }
        inside.stdin(Stdio::null());
        inside
    }

    /// Takes all that is free.
    fn fill(&self) {
        let mut filler = Command::new("sh");
        // dd fails, as it shall.
        filler.args(["-c", "dd if=/dev/zero bs=4k 2>/dev/null >>/dev/shm/filler; test -s /dev/shm/filler"]);
        assert!(self.inside(&filler).status().expect("sh runs").success());
    }

    fn make_room(&self) {
        let mut remover = Command::new("rm");
        remover.arg("/dev/shm/filler");
        assert!(self.inside(&remover).status().expect("rm runs").success());
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn too_little_memory_is_said_with_the_numbers_and_nothing_starts() {
    for megabytes in [4, 16] {
        let Some(memory) = Memory::of(megabytes) else { return };
        let place = Place::new();
        let output = memory.inside(&place.command(&["up"])).output().expect("pursuit up runs");
        let (_, error) = text(&output);
        assert_eq!(output.status.code(), Some(1), "{error}");
        assert!(error.contains(&format!("{megabytes} MB free")) && error.contains("make room"), "{error}");
        place.assert_nothing_left();
    }
}

#[test]
fn a_run_goes_on_when_memory_is_full_and_who_comes_then_is_told() {
    let Some(memory) = Memory::of(300) else { return };
    let place = Place::new();
    let arguments = ["up", "--set", "learner.training_moves=4", "--set", "run.pace=\"real\""];
    let log = std::fs::File::create(place.directory.join("up.log")).expect("a log file");
    let child = memory.inside(&place.command(&arguments)).stdout(Stdio::piped()).stderr(log).spawn();
    let mut system = System { place: &place, child: child.expect("pursuit up starts") };
    let ask = |arguments: &[&str]| memory.inside(&place.command(arguments)).output().expect("it runs");
    let states = || {
        let output = ask(&["status", "--json"]);
        let all: Vec<serde_json::Value> = if output.status.success() {
            serde_json::from_slice(&output.stdout).expect("JSON")
        } else {
            vec![]
        };
        (!all.is_empty() && all.iter().all(|s| s["state"] == "running")).then_some(all)
    };
    let before = wait_for(states).unwrap_or_else(|| panic!("{}", place.log()));
    system.wait_for_phase(2);
    memory.fill();
    // A status without the arm's line, and no SIGBUS.
    let output = ask(&["status"]);
    assert!(output.status.success(), "{:?}", text(&output));
    // A new process is refused with the reason, and the old one stays.
    let output = ask(&["restart", "vision"]);
    let (_, error) = text(&output);
    assert_eq!(output.status.code(), Some(1), "{error}\n{}", place.log());
    assert!(error.contains("shared memory is full"), "{error}");
    let output = ask(&["record", "--seconds", "1"]);
    assert!(text(&output).1.contains("shared memory is full"), "{:?}", text(&output));
    let full = states().expect("all run while memory is full");
    assert_eq!(pid_of(&full, "vision"), pid_of(&before, "vision"), "{}", place.log());
    let answered = |all: &[serde_json::Value]| {
        all.iter().find(|s| s["service"] == "vision").and_then(|s| s["answered"].as_u64()).expect("a count")
    };
    assert!(answered(&full) > answered(&before), "it answers while memory is full");
    // One that dies is back: at once, or when there is room.
    kill(pid_of(&full, "segmentation"), Signal::KILL);
    memory.make_room();
    let after =
        wait_for(|| states().filter(|all| pid_of(all, "segmentation") != pid_of(&full, "segmentation")));
    let after = after.unwrap_or_else(|| panic!("{}", place.log()));
    assert_eq!(pid_of(&after, "vision"), pid_of(&before, "vision"), "nobody else was restarted");
    system.signal(Signal::TERM);
    assert!(system.end().0.success());
    place.assert_nothing_left();
}
