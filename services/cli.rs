//! The command line.

use crate::chaos::plan::Kind;
use clap::{Args, Parser, Subcommand, ValueEnum};
use pursuit_runtime::place;
use std::path::PathBuf;

/// Makes a robot follow what moves: a camera in the hand of an arm finds what moves independently of it,
/// and the arm teaches itself to stay above it.
#[derive(Parser)]
#[command(name = "pursuit", version, propagate_version = true)]
pub struct Cli {
    /// What to do; without a word it is `demo`.
    #[command(subcommand)]
    pub verb: Option<Verb>,
}

/// All verbs.
#[derive(Subcommand)]
pub enum Verb {
    /// Simulated robot: teaches itself, follows a camouflaged vehicle, reports. Ends by itself.
    Demo(Demo),
    /// Start all services under a supervisor, until stopped or for a number of frames.
    Up(Up),
    /// One service in the foreground.
    Run {
        /// simulator, acquisition, vision, segmentation, learner, arm-driver or observer.
        service: String,
        /// Where the instance lives.
        #[command(flatten)]
        place: Place,
    },
    /// How are the services?
    Status {
        /// Where the instance lives.
        #[command(flatten)]
        place: Place,
        /// As JSON.
        #[arg(long)]
        json: bool,
    },
    /// One screen: services, hops, target, learner; refreshed until stopped.
    Top(Top),
    /// Where do the frames' times go? Latency of the running system, hop by hop.
    Trace(Trace),
    /// One page on one of the last 512 frames: times, what vision saw, what was decided, what the arm did.
    Why {
        /// Its number.
        frame: u64,
        /// Where the instance lives.
        #[command(flatten)]
        place: Place,
    },
    /// Start one service anew: the new process takes over from the old one, and no frame is lost where it can.
    Restart {
        /// Its name.
        service: String,
        /// From this program file from now on, in place of the one that is on the disk where it was started from.
        #[arg(long, value_name = "FILE")]
        program: Option<PathBuf>,
        /// Where the instance lives.
        #[command(flatten)]
        place: Place,
    },
    /// Stop the arm, whatever else is alive; it stays at rest until `reset`.
    Stop {
        /// Where the instance lives.
        #[command(flatten)]
        place: Place,
        /// A protective stop in place of an emergency stop.
        #[arg(long)]
        protective: bool,
    },
    /// End the arm's stops: an operator says that it may move again.
    Reset {
        /// Where the instance lives.
        #[command(flatten)]
        place: Place,
    },
    /// Let an arm follow set-points that is not activated by itself (`arm.activate = "operator"`).
    Activate {
        /// Where the instance lives.
        #[command(flatten)]
        place: Place,
    },
    /// End everything.
    Down {
        /// Where the instance lives.
        #[command(flatten)]
        place: Place,
    },
    /// Record everything that travels between the services, as an MCAP file.
    Record(Record),
    /// Did the arm keep its limits, and was it at rest when it had to be? Checks a recording.
    Audit(Audit),
    /// A recording as one HTML page with the paper's figures made from it.
    Report(RunReport),
    /// A recording once more through vision and segmentation: is it the same to the bit?
    Replay(Replay),
    /// Find what moves in a folder of images, a video or a recording.
    Detect(Detect),
    /// A measured experiment in lock-step, the paper's figure beside ours.
    Experiment(Experiment),
    /// Kills, stops and lies to random services of a simulated system, and checks what must hold all the same.
    Chaos(Chaos),
    /// Is this machine fit to run it, and did anything stay behind?
    Doctor(Doctor),
    /// Check a config file.
    Check {
        /// The file.
        file: PathBuf,
    },
}

/// Where an instance lives.
#[derive(Args, Clone, Debug, Default)]
pub struct Place {
    /// Name of the instance [default: sim, or the config's run.instance].
    #[arg(long)]
    pub instance: Option<String>,
    /// Its run-time directory, in place of one below $XDG_RUNTIME_DIR.
    #[arg(long)]
    pub run_dir: Option<PathBuf>,
}

impl Place {
    /// The run-time directory.
    pub fn directory(&self) -> PathBuf {
        self.directory_or(place::DEFAULT_INSTANCE)
    }

    /// The run-time directory; `instance` where the command line names none.
    pub fn directory_or(&self, instance: &str) -> PathBuf {
        match &self.run_dir {
            Some(directory) => directory.clone(),
            None => place::directory(self.instance.as_deref().unwrap_or(instance)),
        }
    }
}

/// Options of `up`.
#[derive(Args, Clone, Debug, Default)]
pub struct Up {
    /// Config file [default: the built-in config/sim.toml].
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// End after so many frames of tracking, and report.
    #[arg(long)]
    pub frames: Option<u64>,
    /// Seed of everything random.
    #[arg(long)]
    pub seed: Option<u64>,
    /// Set a key of the config: --set vehicle.speed_m_per_s=0.2
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Write the report there, as JSON (`-`: to standard output).
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write plots into this folder.
    #[arg(long, value_name = "DIR")]
    pub plots: Option<PathBuf>,
    /// Where the instance lives.
    #[command(flatten)]
    pub place: Place,
}

/// Options of `top`.
#[derive(Args, Clone, Debug)]
pub struct Top {
    /// Time between two screens, s; the first comes after that.
    #[arg(long, default_value_t = 1.0)]
    pub every: f64,
    /// One screen, then end.
    #[arg(long)]
    pub once: bool,
    /// Where the instance lives.
    #[command(flatten)]
    pub place: Place,
}

/// Options of `trace`.
#[derive(Args, Clone, Debug)]
pub struct Trace {
    /// Measure for so long.
    #[arg(long, default_value_t = 5.0)]
    pub seconds: f64,
    /// Write the figures there, as JSON (`-`: to standard output).
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Write a timeline there, for Perfetto or Chrome's trace viewer.
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Where the instance lives.
    #[command(flatten)]
    pub place: Place,
}

/// Options of `demo`.
#[derive(Args, Clone, Debug, Default)]
pub struct Demo {
    /// Frames of tracking [default: 750].
    #[arg(long)]
    pub frames: Option<u64>,
    /// Seed of everything random.
    #[arg(long)]
    pub seed: Option<u64>,
    /// Write the report there, as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Folder for the plots [default: pursuit-out].
    #[arg(long, value_name = "DIR")]
    pub plots: Option<PathBuf>,
    /// Where the instance lives.
    #[command(flatten)]
    pub place: Place,
}

/// Options of `record`.
#[derive(Args, Clone, Debug, Default)]
pub struct Record {
    /// The file [default: pursuit.mcap].
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// End after so many seconds.
    #[arg(long, value_name = "S")]
    pub seconds: Option<f64>,
    /// Where nothing runs yet, wait for it: the recording then begins with the run.
    #[arg(long)]
    pub wait: bool,
    /// Where the instance lives.
    #[command(flatten)]
    pub place: Place,
}

/// Options of `doctor`.
#[derive(Args, Clone, Debug)]
pub struct Doctor {
    /// Config file [default: the built-in config/sim.toml].
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// As JSON.
    #[arg(long)]
    pub json: bool,
    /// Where the instance lives.
    #[command(flatten)]
    pub place: Place,
}

/// Options of `chaos`.
#[derive(Args, Clone, Debug)]
pub struct Chaos {
    /// So long, s.
    #[arg(long, default_value_t = 60.0)]
    pub seconds: f64,
    /// Seed of the faults: the same ones in the same order.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// These kinds of faults only.
    #[arg(long, value_name = "KINDS", value_delimiter = ',')]
    pub faults: Vec<Kind>,
    /// Set a key of the config.
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Write the figures there, as JSON (`-`: to standard output).
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Record the run there, and check the recording as `audit` does.
    #[arg(long, value_name = "FILE")]
    pub record: Option<PathBuf>,
    /// Its run-time directory, in place of one below $XDG_RUNTIME_DIR.
    #[arg(long)]
    pub run_dir: Option<PathBuf>,
}

/// Options of `audit`.
#[derive(Args, Clone, Debug)]
pub struct Audit {
    /// The recording, of a run on the wall clock.
    pub file: PathBuf,
    /// As JSON.
    #[arg(long)]
    pub json: bool,
}

/// Options of `report`.
#[derive(Args, Clone, Debug)]
pub struct RunReport {
    /// The recording.
    pub file: PathBuf,
    /// The page [default: beside the recording, with the ending .html].
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Options of `replay`.
#[derive(Args, Clone, Debug)]
pub struct Replay {
    /// The recording.
    pub file: PathBuf,
    /// Through acquisition, vision and segmentation as processes of their own, in place of in this one.
    #[arg(long)]
    pub services: bool,
    /// With --services: times as fast as it was.
    #[arg(long, default_value_t = 1.0)]
    pub speed: f64,
    /// With --services: begin so many seconds after the first frame.
    #[arg(long, value_name = "S", default_value_t = 0.0)]
    pub from: f64,
    /// With --services: again and again, until it is stopped.
    #[arg(long = "loop")]
    pub again: bool,
    /// Where the instance lives (--services).
    #[command(flatten)]
    pub place: Place,
    /// Set a key of the recording's config: what another detector would have said.
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Write the outcome there, as JSON (`-`: to standard output).
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// Options of `detect`.
#[derive(Args, Clone, Debug)]
pub struct Detect {
    /// Folder with the images, taken in natural order of name, a video (decoded by ffmpeg), or a recording (.mcap).
    pub path: PathBuf,
    /// One JSON object per frame.
    #[arg(long)]
    pub json: bool,
    /// Write images with the detection drawn in.
    #[arg(long, value_name = "DIR")]
    pub annotate: Option<PathBuf>,
    /// Write the 12 vote fields of each pair of images, as the paper's figure 4.
    #[arg(long, value_name = "DIR")]
    pub fields: Option<PathBuf>,
    /// Write the pyramid of each image and what changed in it, as the paper's figure 2.
    #[arg(long, value_name = "DIR")]
    pub figure2: Option<PathBuf>,
    /// Config file for the sections [vision] and [segmentation].
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Set a key of these sections: --set segmentation.contrast_cut=6
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
}

/// Options of `experiment`.
#[derive(Args, Clone, Debug)]
pub struct Experiment {
    /// Which one.
    pub name: ExperimentName,
    /// Number of seeds [default: 30; of stopping 50, of robustness and ablation 5].
    #[arg(long)]
    pub seeds: Option<u64>,
    /// The first seed.
    #[arg(long, default_value_t = 1)]
    pub first_seed: u64,
    /// Set a key of the config for all runs.
    #[arg(long, value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Write all figures there, as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Folder for the plots [default: pursuit-out].
    #[arg(long, value_name = "DIR")]
    pub plots: Option<PathBuf>,
    /// Robustness, ablation: these scenarios only, as `--scenes pan,empty_pan`. Change: these changes only, as
    /// `--scenes turn-20,focal-2`.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub scenes: Vec<String>,
    /// Robustness, ablation: sides of the frames, px [default: 512,256; of ablation 512].
    #[arg(long, value_name = "PX", value_delimiter = ',')]
    pub sizes: Vec<usize>,
    /// Robustness, ablation: write the first seed's frames and truths there, one folder for each sequence.
    #[arg(long, value_name = "DIR")]
    pub frames: Option<PathBuf>,
    /// Tracking, calibrated: these paths only, as `--paths circle,square`; any of these filters asks for all
    /// combinations of what is named.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub paths: Vec<String>,
    /// Tracking, calibrated: speeds of the vehicle, m/s.
    #[arg(long, value_name = "M/S", value_delimiter = ',')]
    pub speeds: Vec<f64>,
    /// Tracking, calibrated: images per second.
    #[arg(long, value_name = "HZ", value_delimiter = ',')]
    pub rates: Vec<f64>,
    /// Tracking, calibrated: simulated time from a command to its effect, ms.
    #[arg(long, value_name = "MS", value_delimiter = ',')]
    pub latencies: Vec<f64>,
    /// Learning: these schemes only, as `--schemes recommended,paper`.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub schemes: Vec<String>,
    /// Tracking: these laws only, plain, predictive.
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub controllers: Vec<String>,
}

impl Experiment {
    /// Whether conditions of following are named.
    pub fn names_conditions(&self) -> bool {
        let numbers = [&self.speeds, &self.rates, &self.latencies];
        numbers.iter().any(|list| !list.is_empty()) || !self.paths.is_empty() || !self.controllers.is_empty()
    }

    /// Number of seeds, at least one.
    pub fn seeds(&self) -> u64 {
        let usual = match self.name {
            ExperimentName::Stopping => 50,
            name if name.runs_the_arm() => 30,
            _ => 5,
        };
        self.seeds.unwrap_or(usual).max(1)
    }
}

/// All experiments.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ExperimentName {
    /// Moves to 3 cm and 1 cm, error after each move, recommended and paper scheme.
    Learning,
    /// Distance from the hand to the vehicle while following it.
    Tracking,
    /// Moves and time until the hand is right again after its camera was turned, got another lens, or its
    /// forearm changed: at the start, in the middle of training, and while it follows.
    Change,
    /// Learning while 0, 5, 15, 30 % of the detections are wrong, anywhere in the image.
    Outliers,
    /// The same with a perfectly calibrated robot beside it: the ceiling.
    Calibrated,
    /// How long and how far the hand goes on after a kill, a hang, frozen frames, an emergency stop, a lost bus.
    Stopping,
    /// What the detectors find, and where, in sequences with exact truth. The times are of one thread among
    /// others: a loaded machine distorts them.
    Robustness,
    /// The robust detector with one of its parts changed at a time.
    Ablation,
}

impl ExperimentName {
    /// Whether arm and learner take part, so that keys of the config count; else it is about detectors alone.
    pub fn runs_the_arm(self) -> bool {
        !matches!(self, ExperimentName::Robustness | ExperimentName::Ablation)
    }
}
