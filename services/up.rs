//! `pursuit up`: all services under the supervisor, and the report when a run ends by itself.

use crate::check::{self, Checked};
use crate::cli::Up;
use crate::plots;
use crate::progress::Progress;
use crate::report::{Learnt, Report};
use crate::uncertainty;
use pursuit_acquisition::config::Source;
use pursuit_arm_driver::safety::Travel;
use pursuit_arm_driver::step::Driver;
use pursuit_config::{Document, Faults};
use pursuit_learner::step::Learner;
use pursuit_messages::Service;
use pursuit_runtime::{exit, logging, place};
use pursuit_simulator::journal::{MoveRecord, Record};
use pursuit_supervisor::{Ended, Plan, SupervisorError};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Runs the verb.
pub fn run(options: &Up) -> u8 {
    let document = match document(options) {
        Ok(document) => document,
        Err(faults) => {
            eprintln!("{faults}");
            return exit::DO_NOT_RESTART;
        }
    };
    match run_system(options, document) {
        Ok(Some(run)) => {
            let code = run.publish(options.json.as_deref(), options.plots.as_deref());
            if options.json.as_deref() != Some(Path::new("-")) {
                println!("\n{}", run.report.text());
            }
            code
        }
        Ok(None) => exit::OK,
        Err(code) => code,
    }
}

/// The config of the command line. Without a number of frames the run is for watching: lock-step then
/// keeps to real time unless the config says otherwise.
fn document(options: &Up) -> Result<Document, Faults> {
    let mut set = Vec::new();
    if options.frames.is_none() && options.config.is_none() {
        set.push("run.pace=real".to_owned());
    }
    set.extend(options.set.iter().cloned());
    if let Some(frames) = options.frames {
        set.push(format!("simulator.frames={frames}"));
    }
    if let Some(seed) = options.seed {
        set.push(format!("run.seed={seed}"));
    }
    if let Some(instance) = &options.place.instance {
        set.push(format!("run.instance={instance}"));
    }
    check::document(options.config.as_deref(), &set)
}

/// A run that is over.
pub struct Run {
    /// Its report.
    pub report: Report,
    records: Vec<Record>,
    moves: Vec<MoveRecord>,
    learner: Option<Learner>,
    half_width_px: f64,
}

/// Runs the system; a report where it came to its end by itself.
///
/// # Errors
/// The exit code; why was said on standard error.
pub fn run_system(options: &Up, mut document: Document) -> Result<Option<Run>, u8> {
    logging::start();
    let refuse = |faults: Faults| {
        eprintln!("{faults}");
        exit::DO_NOT_RESTART
    };
    let checked = check::all(&document).map_err(refuse)?;
    if let Source::Files(files) = &checked.acquisition.source {
        // The services read the config from another folder: a relative path would be another one there.
        let folder = std::path::absolute(&files.folder).unwrap_or_else(|_| files.folder.clone());
        document.set("acquisition.folder", &format!("{:?}", folder.display().to_string())).map_err(refuse)?;
    }
    if let Source::Recorded(recorded) = &checked.acquisition.source {
        let file = std::path::absolute(&recorded.file).unwrap_or_else(|_| recorded.file.clone());
        document.set("acquisition.file", &format!("{:?}", file.display().to_string())).map_err(refuse)?;
    }
    let directory = options.place.directory_or(&checked.acquisition.run.instance);
    let program = std::env::current_exe().map_err(|error| {
        eprintln!("pursuit: cannot find my own program file: {error}");
        exit::FAILED
    })?;
    if let Ok(driver) = Driver::new(checked.arm.parameters, checked.arm.coupling) {
        let latency_s = checked.simulator.cell.latency_ns as f64 * 1e-9;
        eprintln!("{}", Travel::worst(&driver, latency_s).text());
    }
    let mut progress =
        Progress::new(checked.learner.parameters.training_moves, checked.simulator.cell.frames);
    let frame_bytes = checked.acquisition.camera.shape().bytes();
    let bounded = checked.simulator.cell.frames > 0;
    let observed = checked.observer.is_started();
    let mut page = checked.observer.metrics.filter(|_| observed);
    let services = Service::ALL.into_iter().filter(|service| service.is_in_the_loop() || observed).collect();
    let lease = Duration::from_nanos(checked.simulator.run.lease_ns);
    let plan =
        Plan { directory: directory.clone(), document, program, services, frame_bytes, bounded, lease };
    let mut restarts = 0;
    let ended = supervise(plan, |glance| {
        if let Some(address) = page.take() {
            let token = std::fs::read_to_string(glance.directory.join(place::TOKEN)).unwrap_or_default();
            eprintln!("live page: http://{address}/#{token}");
        }
        restarts = glance.services.iter().map(|s| s.restarts).sum();
        progress.look(glance);
    });
    progress.done();
    match ended {
        Ok(Ended::Finished) => {
            let over = Instant::now();
            let wall_s = progress.first_frame().map_or(0.0, |first| (over - first).as_secs_f64());
            Ok(Some(read_run(&directory, &checked, wall_s, restarts)))
        }
        Ok(Ended::Stopped) => Ok(None),
        Ok(Ended::Failed(why)) => {
            eprintln!("pursuit: {why}");
            Err(exit::DO_NOT_RESTART)
        }
        Err(error) => {
            eprintln!("pursuit: {error}");
            Err(match error {
                SupervisorError::Held(_) => exit::HELD,
                _ => exit::FAILED,
            })
        }
    }
}

fn supervise(
    plan: Plan,
    watch: impl FnMut(&pursuit_supervisor::Glance<'_>),
) -> Result<Ended, SupervisorError> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime
        .map_err(|cause| SupervisorError::System { what: "cannot start the supervisor's runtime", cause })?;
    runtime.block_on(pursuit_supervisor::run(plan, watch))
}

fn read_run(directory: &Path, checked: &Checked, wall_s: f64, restarts: u32) -> Run {
    let lines = |name| std::fs::read_to_string(directory.join(name)).unwrap_or_default();
    let records: Vec<Record> = lines(place::JOURNAL).lines().filter_map(Record::parse).collect();
    let moves: Vec<MoveRecord> = lines(place::MOVES).lines().filter_map(MoveRecord::parse).collect();
    let mut report = Report::of(checked.simulator.run.seed, &records, &moves);
    let simulated_s = records.last().map_or(0.0, |last| last.time_s - records[0].time_s);
    report.took(wall_s, simulated_s);
    report.restarts = restarts;
    let checkpoint = directory.join(place::checkpoint(Service::Learner.name()));
    let learner = pursuit_learner::saved(&checkpoint, &checked.learner.parameters);
    report.learner = learner.as_ref().map(|learner| Learnt::of(&learner.report()));
    let half_width_px = f64::from(checked.acquisition.camera.width) / 2.0;
    report.trajectory_sha256 = std::fs::read_to_string(directory.join(place::TRAJECTORY)).ok();
    Run { report, records, moves, learner, half_width_px }
}

impl Run {
    /// Writes what was asked for; the exit code.
    pub fn publish(&self, json: Option<&Path>, plots: Option<&Path>) -> u8 {
        let mut code = exit::OK;
        if let Some(file) = json {
            code = code.max(write_json(file, &self.report));
        }
        if let Some(folder) = plots {
            match self.plot(folder) {
                Ok(files) => files.iter().for_each(|file| eprintln!("plot: {}", file.display())),
                Err(error) => {
                    eprintln!("pursuit: cannot write plots into {}: {error}", folder.display());
                    code = exit::FAILED;
                }
            }
        }
        code
    }

    /// Draws the paper's figures 6 and 7, the learning curve and where the map is sure of itself; the files.
    ///
    /// # Errors
    /// The file system's reason.
    pub fn plot(&self, folder: &Path) -> std::io::Result<Vec<PathBuf>> {
        std::fs::create_dir_all(folder)?;
        let uncertainty = self
            .learner
            .as_ref()
            .map(|learner| ("uncertainty.svg", uncertainty::picture(learner, self.half_width_px)));
        plots::of_run(&self.records, &self.moves)
            .into_iter()
            .chain(uncertainty)
            .map(|(name, svg)| {
                let file = folder.join(name);
                std::fs::write(&file, svg).map(|()| file)
            })
            .collect()
    }
}

/// Writes a value as JSON into `file`, or to standard output where it is `-`; the exit code.
pub fn write_json(file: &Path, value: &impl serde::Serialize) -> u8 {
    let text = serde_json::to_string_pretty(value).unwrap_or_default() + "\n";
    if file == Path::new("-") {
        print!("{text}");
        return exit::OK;
    }
    match std::fs::write(file, text) {
        Ok(()) => exit::OK,
        Err(error) => {
            eprintln!("pursuit: cannot write {}: {error}", file.display());
            exit::FAILED
        }
    }
}
