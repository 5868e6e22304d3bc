//! `pursuit stop`, `reset` and `activate`: what an operator says to the arm driver, whoever else is alive.

use pursuit_arm_driver::safety::Refused;
use pursuit_bus::{Bus, Instance};
use pursuit_messages::topics::DriverStates;
use pursuit_messages::{ArmEvent, ArmState, DriverState, Refusal};
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::exit;
use pursuit_runtime::latch::{Latch, Latches, Wish};
use std::path::Path;
use std::time::{Duration, Instant};

/// A driver looks for stops and wishes each turn of its loop; this is patience with a loaded machine.
const PATIENCE: Duration = Duration::from_secs(5);
/// Who says nothing for so long is not there: a driver tells its state ten times a second.
const STATE_PATIENCE: Duration = Duration::from_millis(500);
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

/// What `pursuit status` says of the arm: the driver's word, and stops that are set.
pub fn arm(directory: &Path) -> String {
    let stop = match Latches::open(directory).ok().and_then(|latches| latches.set()) {
        Some(Latch::Emergency) => "the arm has an emergency stop, until `pursuit reset`\n",
        Some(Latch::Protective) => "the arm has a protective stop, until `pursuit reset`\n",
        None => "",
    };
    let Some(state) = driver_state(directory) else {
        return format!(
            "the arm driver says nothing: the drives are at rest or come to rest by themselves\n{stop}"
        );
    };
    let word = state.state().map_or("unknown", ArmState::word);
    let cause = state.cause().map_or("", ArmEvent::text);
    let motion = if state.at_rest == 1 { "at rest" } else { "moving" };
    let since_s = monotonic_ns().saturating_sub(state.since_ns) as f64 * 1e-9;
    let refusal =
        refusal(&state).map_or(String::new(), |why| format!("; the last set-point was refused: {why}"));
    format!("arm: {word}, {motion}, since {since_s:.1} s ({cause}){refusal}\n{stop}")
}

/// The same for programs.
pub fn arm_json(directory: &Path) -> serde_json::Value {
    driver_state(directory).map_or(serde_json::Value::Null, |state| {
        serde_json::json!({
            "state": state.state().map(ArmState::word),
            "cause": state.cause().map(ArmEvent::word),
            "since_ms": monotonic_ns().saturating_sub(state.since_ns) / 1_000_000,
            "at_rest": state.at_rest == 1,
            "refusal": refusal(&state),
        })
    })
}

fn refusal(state: &DriverState) -> Option<&'static str> {
    Refusal::from_number(state.refusal).map(Refusal::text)
}

/// What the driver says now, if there is one.
fn driver_state(directory: &Path) -> Option<DriverState> {
    let bus = Bus::join(&Instance::at(directory).ok()?, "operator").ok()?;
    let states = bus.reader(DriverStates).ok()?;
    let limit = Instant::now() + STATE_PATIENCE;
    while Instant::now() < limit {
        if let Some((state, _)) = states.newest().ok()? {
            return Some(*state.payload());
        }
        std::thread::sleep(LOOK);
    }
    None
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
