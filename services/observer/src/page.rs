//! The live page: what it shows of the running system, as one answer for each question of the browser. It is
//! filled only while somebody looks. Nothing here moves, restarts or sets anything: that is [`crate::actions`].

use crate::account::Account;
use crate::ears::Heard;
use crate::endpoint::Answer;
use pursuit_bus::FrameMessage;
use pursuit_messages::{Detection, DriverState, HOPS, Health, Lack, Service, Target, TrackPhase, Votes};
use serde_json::{Value, json};
use std::collections::VecDeque;

/// After the last question it goes on being filled for so long, ns.
const WATCHED_NS: u64 = 3_000_000_000;
/// Points of the way that are kept: at 12.5 images per second 48 s.
const WAY: usize = 600;
/// The image is shown with at most so many pixels per row.
const WIDEST: usize = 320;

/// What the page shows.
#[derive(Default)]
pub struct Live {
    watched_until_ns: u64,
    frame: u64,
    /// Columns, rows, and how many pixels of the camera are one of these.
    size: (usize, usize, usize),
    pixels: Vec<u8>,
    fields: Value,
    target: Option<Target>,
    arm: Option<DriverState>,
    /// Camera and target on the table, m; from the simulator, which alone knows them.
    way: VecDeque<[f64; 4]>,
}

impl Live {
    /// The files of the page, by path.
    pub fn file(path: &str) -> Option<Answer> {
        let (kind, text) = match path {
            "/" => ("text/html", include_str!("page/index.html")),
            "/page.css" => ("text/css", include_str!("page/page.css")),
            "/page.js" => ("text/javascript", include_str!("page/page.js")),
            _ => return None,
        };
        Some(Answer::text(kind, text.to_owned()))
    }

    /// Whether somebody looks.
    pub fn is_watched(&self, now_ns: u64) -> bool {
        now_ns < self.watched_until_ns
    }

    /// Takes in a message.
    pub fn take(&mut self, heard: &Heard<'_>) {
        match heard {
            Heard::Frame(frame) => self.show(frame),
            Heard::Votes(_, votes) => self.fields = fields(votes),
            Heard::Target(_, target) => self.target = Some(**target),
            Heard::Driver(_, state) => self.arm = Some(**state),
            Heard::World(_, world) if world.exposes == 1 => {
                let [x, y, _] = world.camera_position;
                if self.way.len() == WAY {
                    self.way.pop_front();
                }
                self.way.push_back([x, y, world.target_position[0], world.target_position[1]]);
            }
            _ => {}
        }
    }

    /// The newest of everything: a line of JSON, then the image, grey, row by row.
    pub fn answer(&mut self, account: &Account, now_ns: u64) -> Answer {
        self.watched_until_ns = now_ns + WATCHED_NS;
        let (columns, rows, scale) = self.size;
        let micros = |ns: u64| ns as f64 / 1e3;
        let hops: Vec<Value> = HOPS
            .iter()
            .enumerate()
            .map(|(k, hop)| {
                let (wait, compute) = (&account.latency.wait[k], &account.latency.compute[k]);
                json!({
                    "name": hop.name(),
                    "wait_us": micros(wait.quantile_ns(0.5)),
                    "compute_us": micros(compute.quantile_ns(0.5)),
                    "p99_us": micros(wait.quantile_ns(0.99) + compute.quantile_ns(0.99)),
                })
            })
            .collect();
        let learner = account.learner.as_ref().map(|state| {
            json!({
                "phase": state.phase, "moves": state.moves, "samples": state.samples, "ring": state.ring,
                "changes": state.changes, "consistent": state.consistent == 1,
                "lead_ms": state.lead_ns as f64 / 1e6, "offset_ms": state.clock_offset_ns as f64 / 1e6,
                "uncertainty_deg": state.uncertainty_rad.to_degrees(),
                "refits": state.refits_merged, "refits_rejected": state.refits_rejected,
                "refused": state.refused.iter().sum::<u64>(),
            })
        });
        let end_to_end_ms =
            [0.5, 0.99].map(|share| account.latency.end_to_end.quantile_ns(share) as f64 / 1e6);
        let words = json!({
            "frame": self.frame,
            "image": { "columns": columns, "rows": rows, "scale": scale },
            "fields": self.fields,
            "target": self.target.as_ref().map(target),
            "way": self.way,
            "hops": hops,
            "end_to_end_ms": end_to_end_ms,
            "learner": learner,
            "arm": self.arm.as_ref().and_then(arm),
            "services": account.healths.iter().flatten().filter_map(|health| service(health, now_ns)).collect::<Vec<_>>(),
            "restarts": account.restarts,
        });
        let mut body = words.to_string().into_bytes();
        body.push(b'\n');
        body.extend_from_slice(&self.pixels);
        Answer { kind: "application/octet-stream", body }
    }

    /// Every k-th pixel of every k-th row.
    fn show(&mut self, frame: &FrameMessage) {
        let shape = frame.stamp().image;
        let (width, height, stride) = (shape.width as usize, shape.height as usize, shape.stride as usize);
        let step = width.div_ceil(WIDEST).max(1);
        self.frame = frame.stamp().frame;
        self.size = (width.div_ceil(step), height.div_ceil(step), step);
        self.pixels.clear();
        for row in frame.pixels().chunks(stride.max(1)).take(height).step_by(step) {
            self.pixels.extend(row.iter().take(width).step_by(step));
        }
    }
}

/// The vote fields in hundredths of the largest; the page needs no more.
fn fields(votes: &Votes) -> Value {
    let (columns, rows) = (votes.columns as usize, votes.rows as usize);
    let cells = (columns * rows).min(votes.fields[0].len());
    let used = || votes.fields.iter().map(|field| &field[..cells]);
    let most = used().flatten().fold(1e-6f32, |most, value| most.max(value.abs()));
    let values: Vec<Vec<i32>> =
        used().map(|field| field.iter().map(|v| (100.0 * v / most) as i32).collect()).collect();
    json!({ "columns": columns, "rows": rows, "values": values })
}

fn target(target: &Target) -> Value {
    let of = |detection: &Detection| {
        (detection.found == 1).then(|| {
            json!({
                "u": detection.u, "v": detection.v, "vu": detection.vu, "vv": detection.vv,
                "confidence": detection.confidence, "area": detection.area_px,
            })
        })
    };
    let coasting = target.track_phase == TrackPhase::Coasting as u32;
    json!({
        "motion": of(&target.motion), "track": of(&target.track), "blob": of(&target.blob), "coasting": coasting,
        "background": [target.background_u, target.background_v],
    })
}

/// State and cause of the arm, in words.
fn arm(state: &DriverState) -> Option<Value> {
    let (word, cause) = (state.state()?, state.cause()?);
    Some(json!({ "state": word.word(), "cause": cause.text(), "at_rest": state.at_rest == 1 }))
}

fn service(health: &Health, now_ns: u64) -> Option<Value> {
    let service = u16::try_from(health.service).ok().and_then(Service::from_number)?;
    let silent_ms = now_ns.saturating_sub(health.time_ns) as f64 / 1e6;
    Some(json!({
        "name": service.name(), "pid": health.pid, "answered": health.answered, "skipped": health.skipped,
        "refused": health.refused, "lack": Lack::from_number(health.degraded).text(), "silent_ms": silent_ms.round(),
    }))
}
