//! The one entry of `pursuit`: a service or a verb, by its first word.

#![cfg_attr(test, allow(clippy::unwrap_used))]

mod audit;
mod chaos;
mod check;
mod cli;
mod demo;
mod detect;
mod doctor;
mod experiment;
mod inprocess;
mod operate;
mod parallel;
mod plots;
mod progress;
mod record;
mod replay;
mod report;
mod robustness;
mod run_report;
mod svg;
mod top;
mod trace;
mod uncertainty;
mod up;

use clap::Parser;
use cli::{Cli, Verb};
use pursuit_messages::Service;
use pursuit_runtime::{ServiceError, Station, exit};
use pursuit_supervisor::control::{Answer, Request};
use pursuit_supervisor::{control, instance, status};
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// `pursuit down` waits this long for the supervisor to be gone.
const DOWN_LIMIT: Duration = Duration::from_secs(15);

fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(error) => {
            let code = if error.use_stderr() { exit::DO_NOT_RESTART } else { exit::OK };
            let _ = error.print();
            return ExitCode::from(code);
        }
    };
    let code = match cli.verb.unwrap_or(Verb::Demo(cli::Demo::default())) {
        Verb::Demo(options) => demo::run(&options),
        Verb::Up(options) => up::run(&options),
        Verb::Run { service, place } => serve(&service, &place.directory()),
        Verb::Status { place, json } => show_status(&place.directory(), json),
        Verb::Top(options) => top::run(&options),
        Verb::Trace(options) => trace::run(&options),
        Verb::Why { frame, place } => trace::why(frame, &place.directory()),
        Verb::Restart { service, program, place } => {
            // The supervisor may be in another folder.
            let program = program.map(|file| std::path::absolute(&file).unwrap_or(file));
            settle(control_of(&place.directory(), &Request::Restart { service, program }))
        }
        Verb::Stop { place, protective } => operate::stop(&place.directory(), protective),
        Verb::Activate { place } => operate::activate(&place.directory()),
        Verb::Reset { place } => operate::reset(&place.directory()),
        Verb::Down { place } => down(&place.directory()),
        Verb::Record(options) => record::run(&options),
        Verb::Audit(options) => audit::run(&options),
        Verb::Report(options) => run_report::run(&options),
        Verb::Replay(options) => replay::run(&options),
        Verb::Detect(options) => detect(&options),
        Verb::Experiment(options) => experiment::run(&options),
        Verb::Chaos(options) => chaos::run(&options),
        Verb::Doctor(options) => doctor::run(&options),
        Verb::Check { file } => check::run(&file),
    };
    ExitCode::from(code)
}

/// One service in the foreground, whoever supervises it.
fn serve(name: &str, directory: &Path) -> u8 {
    let Some(service) = Service::from_name(name).filter(|service| Service::ALL.contains(service)) else {
        let known = Service::ALL.map(Service::name).join(", ");
        eprintln!("pursuit: {name:?} is not a service; there are {known}");
        return exit::DO_NOT_RESTART;
    };
    let run: fn(Station) -> Result<(), ServiceError> = match service {
        Service::Simulator => pursuit_simulator::run,
        Service::Acquisition => pursuit_acquisition::run,
        Service::Vision => pursuit_vision::run,
        Service::Segmentation => pursuit_segmentation::run,
        Service::Learner => pursuit_learner::run,
        Service::ArmDriver => pursuit_arm_driver::run,
        Service::Observer => pursuit_observer::run,
        Service::Supervisor => return exit::DO_NOT_RESTART,
    };
    match Station::start(service, directory).and_then(run) {
        Ok(()) => exit::OK,
        Err(error) => {
            eprintln!("pursuit {name}: {error}");
            error.exit_code()
        }
    }
}

fn control_of(directory: &Path, request: &Request) -> Result<Answer, u8> {
    control::ask(&directory.join(pursuit_runtime::place::CONTROL), request).map_err(|error| {
        eprintln!("pursuit: nothing runs in {} ({error}); start it with `pursuit up`", directory.display());
        exit::FAILED
    })
}

fn settle(answer: Result<Answer, u8>) -> u8 {
    match answer {
        Ok(Answer::Refused { why }) => {
            eprintln!("pursuit: {why}");
            exit::FAILED
        }
        Ok(_) => exit::OK,
        Err(code) => code,
    }
}

fn show_status(directory: &Path, json: bool) -> u8 {
    match control_of(directory, &Request::Status) {
        Ok(Answer::Status { services }) => {
            let text = if json {
                status_json(&services, directory)
            } else {
                status::table(&services) + &operate::arm(directory)
            };
            // Whoever reads may have gone (`| head`): nothing to do about it.
            let _ = std::io::stdout().write_all(text.as_bytes());
            exit::OK
        }
        other => settle(other),
    }
}

/// The services, and with the arm driver what it says of the arm.
fn status_json(services: &[status::ServiceStatus], directory: &Path) -> String {
    let with_arm = |service: &status::ServiceStatus| {
        let mut value = serde_json::to_value(service).unwrap_or_default();
        if service.service == Service::ArmDriver.name() {
            value["arm"] = operate::arm_json(directory);
        }
        value
    };
    let all: Vec<serde_json::Value> = services.iter().map(with_arm).collect();
    serde_json::to_string(&all).unwrap_or_default() + "\n"
}

fn down(directory: &Path) -> u8 {
    let code = settle(control_of(directory, &Request::Down));
    if code != exit::OK {
        return code;
    }
    let limit = Instant::now() + DOWN_LIMIT;
    while instance::is_held(directory) {
        if Instant::now() > limit {
            eprintln!("pursuit: the supervisor was asked to end but is still there");
            return exit::FAILED;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    exit::OK
}

fn detect(options: &cli::Detect) -> u8 {
    let detection = match check::detection(options.config.as_deref(), &options.set) {
        Ok(detection) => detection,
        Err(faults) => {
            eprintln!("{faults}");
            return exit::DO_NOT_RESTART;
        }
    };
    let what = detect::Options {
        path: options.path.clone(),
        json: options.json,
        annotate: options.annotate.clone(),
        fields: options.fields.clone(),
        figure2: options.figure2.clone(),
    };
    match detect::run(&what, &detection, &mut std::io::stdout().lock()) {
        Ok(remark) => {
            if let Some(remark) = remark {
                eprintln!("pursuit detect: {remark}");
            }
            exit::OK
        }
        Err(error) => {
            eprintln!("pursuit detect: {error}");
            exit::BAD_INPUT
        }
    }
}
