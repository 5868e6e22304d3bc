//! `pursuit stop`, `reset` and `activate`: what an operator says to the arm driver, whoever else is alive.

use pursuit_arm_driver::latch::Latches;
use pursuit_arm_driver::safety::{Latch, Refused, Wish};
use pursuit_bus::{Bus, Instance};
use pursuit_messages::ArmEvent;
use pursuit_messages::topics::DriverStates;
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::exit;
use std::path::Path;
use std::time::{Duration, Instant};

/// A driver looks for stops and wishes each turn of its loop; this is patience with a loaded machine.
const PATIENCE: Duration = Duration::from_secs(5);
/// Between two looks at what the driver does.
const LOOK: Duration = Duration::from_millis(5);

/// Stops the arm of the instance in `directory`: it comes to rest and stays so, also if driver or supervisor
/// are started again, until a reset.
pub fn stop(directory: &Path, protective: bool) -> u8 {
    let (latch, name) =
        if protective { (Latch::Protective, "protective") } else { (Latch::Emergency, "emergency") };
    match Latches::open(directory).and_then(|latches| latches.latch(latch)) {
        Ok(()) => {
            println!("{name} stop: the arm comes to rest and stays so, until `pursuit reset`");
            exit::OK
        }
        Err(error) => failed("stop", directory, &error),
    }
}

/// What `pursuit status` says of stops.
pub fn stops(directory: &Path) -> &'static str {
    match Latches::open(directory).ok().and_then(|latches| latches.set()) {
        Some(Latch::Emergency) => "the arm has an emergency stop, until `pursuit reset`\n",
        Some(Latch::Protective) => "the arm has a protective stop, until `pursuit reset`\n",
        None => "",
    }
}

/// Ends all stops, if the driver agrees: the arm is at rest, no button is pressed.
pub fn reset(directory: &Path) -> u8 {
    ask(directory, Wish::Reset, "reset")
}

/// Lets the arm follow set-points, if the driver agrees: they come in, and no stop is set.
pub fn activate(directory: &Path) -> u8 {
    ask(directory, Wish::Activate, "activate")
}

fn ask(directory: &Path, wish: Wish, what: &str) -> u8 {
    let latches = match Latches::open(directory) {
        Ok(latches) => latches,
        Err(error) => return failed(what, directory, &error),
    };
    if let Err(error) = latches.wish(wish) {
        return failed(what, directory, &error);
    }
    let limit = Instant::now() + PATIENCE;
    while latches.wishes_for(wish) && Instant::now() < limit {
        std::thread::sleep(LOOK);
    }
    if latches.take_wish().is_some() {
        eprintln!(
            "pursuit: no arm driver is there to {what} the arm, nothing is changed; start one with `pursuit up`"
        );
        return exit::FAILED;
    }
    match answer(directory, monotonic_ns(), limit) {
        Ok(Some(answer)) => match Refused::of(answer) {
            None => {
                println!("{}", answer.text());
                exit::OK
            }
            Some(_) => {
                eprintln!("pursuit: the arm driver does not {what}: {}", answer.text());
                exit::FAILED
            }
        },
        Ok(None) => {
            eprintln!("pursuit: the arm driver took the {what} and ended before it answered; try again");
            exit::FAILED
        }
        Err(error) => {
            eprintln!("pursuit: the arm driver's answer cannot be heard ({error}); try again");
            exit::FAILED
        }
    }
}

/// What the driver says after `taken_ns` that the wish came to.
fn answer(directory: &Path, taken_ns: u64, limit: Instant) -> Result<Option<ArmEvent>, String> {
    let instance = Instance::at(directory).map_err(|e| e.to_string())?;
    let bus = Bus::join(&instance, "operator").map_err(|e| e.to_string())?;
    let states = bus.reader(DriverStates).map_err(|e| e.to_string())?;
    while Instant::now() < limit {
        if let Some((state, _)) = states.newest().map_err(|e| e.to_string())?
            && state.payload().time_ns > taken_ns
        {
            return Ok(ArmEvent::from_number(state.payload().answer));
        }
        std::thread::sleep(LOOK);
    }
    Ok(None)
}

fn failed(what: &str, directory: &Path, error: &std::io::Error) -> u8 {
    eprintln!(
        "pursuit: cannot {what} the arm of {} ({error}). Is it another instance? Press the robot's own stop",
        directory.display()
    );
    exit::FAILED
}
