//! `pursuit doctor`: is this machine fit to run it, and did anything stay behind?

use crate::check;
use crate::cli::Doctor as Options;
use pursuit_bus::{Instance, memory_budget};
use pursuit_messages::Service;
use pursuit_runtime::{exit, place};
use pursuit_supervisor::instance::{is_held, is_running};
use rustix::process::{Resource, getrlimit};
use serde::Serialize;
use std::io::{ErrorKind, Write};
use std::net::TcpListener;
use std::path::Path;

/// Cores below which the services wait for one another.
const CORES: usize = 2;
/// Open files that a supervisor and each service need, with room to spare.
const FILES: u64 = 512;
/// The kernel must have this many times the bus's budget free, as `pursuit up` wants it.
const MEMORY_FACTOR: u64 = 2;

/// What statfs(2) calls a file system in memory.
const TMPFS: u64 = 0x0102_1994;

/// How something is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
enum Grade {
    Ok,
    Warn,
    Fail,
}

/// One thing that was looked at.
#[derive(Clone, Debug, Serialize)]
struct Finding {
    what: &'static str,
    grade: Grade,
    found: String,
    /// What to do about it; empty where nothing.
    advice: String,
}

impl Finding {
    fn new(what: &'static str, grade: Grade, found: String, advice: &str) -> Finding {
        let advice = if grade == Grade::Ok { String::new() } else { advice.to_owned() };
        Finding { what, grade, found, advice }
    }
}

/// Runs the verb: 0 where nothing fails.
pub fn run(options: &Options) -> u8 {
    let checked = check::document(options.config.as_deref(), &[]).and_then(|document| check::all(&document));
    let checked = match checked {
        Ok(checked) => checked,
        Err(faults) => {
            eprintln!("{faults}");
            return exit::DO_NOT_RESTART;
        }
    };
    let directory = options.place.directory_or(&checked.acquisition.run.instance);
    let mut findings = vec![
        cores(),
        memory(checked.acquisition.camera.shape().bytes()),
        open_files(),
        real_time(),
        scheduling(),
        clock(),
        run_directory(&directory),
        leftovers(&directory),
    ];
    findings.extend(checked.observer.metrics.map(|address| port(address, is_held(&directory))));
    let words = if options.json {
        serde_json::to_string_pretty(&findings).unwrap_or_default() + "\n"
    } else {
        findings.iter().map(text).collect()
    };
    // Whoever reads may have gone (`| head`): nothing to do about it.
    let _ = std::io::stdout().write_all(words.as_bytes());
    let worst = findings.iter().map(|finding| finding.grade).max().unwrap_or(Grade::Ok);
    if worst == Grade::Fail { exit::FAILED } else { exit::OK }
}

fn text(finding: &Finding) -> String {
    let grade = match finding.grade {
        Grade::Ok => "ok",
        Grade::Warn => "warn",
        Grade::Fail => "FAIL",
    };
    let mut text = format!("{grade:<5} {:<20} {}\n", finding.what, finding.found);
    if !finding.advice.is_empty() {
        text.push_str(&format!("      {:<20} {}\n", "", finding.advice));
    }
    text
}

fn cores() -> Finding {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let grade = if cores >= CORES { Grade::Ok } else { Grade::Warn };
    Finding::new(
        "cores",
        grade,
        cores.to_string(),
        "on one core the services wait for one another: expect late frames",
    )
}

fn memory(frame_bytes: usize) -> Finding {
    let budget = memory_budget(frame_bytes) as u64;
    match rustix::fs::statvfs("/dev/shm") {
        Ok(shm) => {
            let free = shm.f_bavail * shm.f_frsize;
            let grade = if free >= budget * MEMORY_FACTOR { Grade::Ok } else { Grade::Fail };
            let found = format!("{} MB free, the bus takes at most {} MB", free >> 20, budget >> 20);
            Finding::new(
                "shared memory",
                grade,
                found,
                "make room in /dev/shm, or choose a smaller camera frame",
            )
        }
        Err(error) => {
            Finding::new("shared memory", Grade::Fail, format!("/dev/shm: {error}"), "mount a tmpfs there")
        }
    }
}

fn open_files() -> Finding {
    let limit = getrlimit(Resource::Nofile).current.unwrap_or(u64::MAX);
    let grade = if limit >= FILES { Grade::Ok } else { Grade::Warn };
    Finding::new(
        "open files",
        grade,
        format!("at most {limit}"),
        "raise it: ulimit -n 1024, or LimitNOFILE= in the unit",
    )
}

fn real_time() -> Finding {
    let limit = getrlimit(Resource::Rtprio).current.unwrap_or(u64::MAX);
    let grade = if limit > 0 { Grade::Ok } else { Grade::Warn };
    Finding::new(
        "real-time priority",
        grade,
        format!("up to {limit}"),
        "the arm driver cannot have any: a loaded machine makes its cycles late (LimitRTPRIO=50 in the unit)",
    )
}

/// What the supervisor tells hung from starved by.
fn scheduling() -> Finding {
    let there = std::fs::read_to_string("/proc/self/schedstat").is_ok();
    let (grade, found) = if there { (Grade::Ok, "told") } else { (Grade::Warn, "not told") };
    Finding::new(
        "scheduling times",
        grade,
        found.to_owned(),
        "without /proc/PID/schedstat a service that hangs is not found (kernel option CONFIG_SCHED_INFO)",
    )
}

/// Every stage of every frame asks for the time.
fn clock() -> Finding {
    let file = "/sys/devices/system/clocksource/clocksource0/current_clocksource";
    let name = std::fs::read_to_string(file).map_or("not told".to_owned(), |name| name.trim().to_owned());
    // The others need a system call, and some a device that answers slowly.
    let fast = ["tsc", "kvm-clock", "hyperv_clocksource_tsc_page", "arch_sys_counter"];
    let grade = if fast.contains(&name.as_str()) || name == "not told" { Grade::Ok } else { Grade::Warn };
    Finding::new(
        "clock source",
        grade,
        name,
        "asking for the time is slow with it: see whether the kernel takes tsc (clocksource=tsc)",
    )
}

fn run_directory(directory: &Path) -> Finding {
    let name = directory.display().to_string();
    let exists = directory.exists();
    // The file system is that of the nearest folder that is there.
    let there = directory.ancestors().find(|folder| folder.exists()).unwrap_or(directory);
    let in_memory = rustix::fs::statfs(there).is_ok_and(|about| about.f_type as u64 == TMPFS);
    if !in_memory {
        return Finding::new(
            "run-time directory",
            Grade::Warn,
            format!("{name}, on a disk"),
            "state is written there with every sample, a busy disk holds that up: --run-dir below /dev/shm or /run",
        );
    }
    if !exists {
        return Finding::new("run-time directory", Grade::Ok, format!("{name}, not there yet"), "");
    }
    match Instance::at(directory) {
        Ok(_) => Finding::new("run-time directory", Grade::Ok, name, ""),
        Err(error) => Finding::new("run-time directory", Grade::Fail, name, &error.to_string()),
    }
}

fn leftovers(directory: &Path) -> Finding {
    const WHAT: &str = "leftovers";
    if is_held(directory) {
        return Finding::new(WHAT, Grade::Ok, "none: it runs".to_owned(), "");
    }
    if is_running(directory) {
        let alive = Service::ALL
            .into_iter()
            .filter(|service| place::holder(&directory.join(place::service_lock(service.name()))).is_some());
        let names: Vec<&str> = alive.map(Service::name).collect();
        let found = format!("{} without a supervisor", names.join(", "));
        return Finding::new(
            WHAT,
            Grade::Warn,
            found,
            "pursuit up adopts them; else they end by themselves soon",
        );
    }
    let objects = if directory.exists() {
        Instance::at(directory).map_or(0, |instance| instance.shared_memory_objects().len())
    } else {
        0
    };
    let grade = if objects == 0 { Grade::Ok } else { Grade::Warn };
    let found = format!("{objects} objects of shared memory");
    Finding::new(WHAT, grade, found, "of a run that was killed: the next pursuit up takes them away")
}

fn port(address: std::net::SocketAddr, is_held: bool) -> Finding {
    let (grade, found) = match TcpListener::bind(address) {
        Ok(_) => (Grade::Ok, format!("{address}")),
        Err(error) if error.kind() == ErrorKind::AddrInUse && is_held => {
            (Grade::Ok, format!("{address}, in use"))
        }
        Err(error) if error.kind() == ErrorKind::AddrInUse => {
            (Grade::Warn, format!("{address} is taken by another program"))
        }
        Err(error) => (Grade::Warn, format!("{address}: {error}")),
    };
    let advice = "there will be none: choose another with --set observer.metrics=127.0.0.1:PORT";
    Finding::new("live page", grade, found, advice)
}
