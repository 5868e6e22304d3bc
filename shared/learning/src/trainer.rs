//! Network, ring and random numbers together: learns online from every view, hands out refits, merges
//! their results.
//!
//! The trainer alone owns the weights. One refit is out at a time; the latest wins.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::change::{MOST_SAMPLES, Verdict, relative_error, surprise};
use crate::coverage::Coverage;
use crate::episode::{Episode, SAMPLES_WITHIN_MOVE};
use crate::network::Network;
use crate::objective::{mean_error, online_step};
use crate::refit::{RefitJob, RefitResult};
use crate::reframe::Frame;
use crate::ring::Ring;
use crate::samples::{Normalisation, Sample, View};
use crate::settings::Settings;
use crate::watch::{Before, Review, Watch};

/// Fewer samples than this are not worth a refit.
const MIN_REFIT_SAMPLES: usize = 4;
/// More samples than this arriving before a result make the result too old to be replayed: several moves'.
const MAX_REPLAYED: usize = 512;

/// Motion beside which the error of [`Trainer::observe`] counts, normalised units.
const FLOOR: f64 = 0.02;

/// What became of a refit's result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Merge {
    /// It is live.
    Merged,
    /// On the ring as it is now the live weights are at least as good.
    NotBetter,
    /// It has weights that are not finite or have run away.
    Unsound,
    /// Nobody waits for it (any more).
    Stale,
}

/// How often what happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Counters {
    /// Samples learnt from.
    pub samples: u64,
    /// Changes of the weights: online steps and merges.
    pub version: u64,
    /// Refits handed out.
    pub refits_started: u64,
    /// Refits that went live.
    pub refits_merged: u32,
    /// Refits that were not better, or unsound, or too old to be replayed.
    pub refits_rejected: u32,
    /// Changes of the world that were noticed.
    pub changes: u32,
    /// Moves that were not learnt from.
    pub discarded_moves: u32,
}

/// A refit that is out: enough to build the same job again.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Outstanding {
    number: u64,
    network: Network,
    /// Fresh weights as another start, after a change.
    fresh: Option<Network>,
    /// Samples learnt online since.
    arrived: Vec<Sample>,
}

/// The whole state of learning.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Trainer {
    settings: Settings,
    network: Network,
    ring: Ring,
    coverage: Coverage,
    episode: Episode,
    /// A fair choice of the samples of the move under way...
    kept: Vec<Sample>,
    /// ...out of this many.
    of_move: u64,
    /// What was known when the move began.
    at_start: Before,
    /// Samples within the move under way, [`MOST_SAMPLES`] at most.
    within: Vec<Sample>,
    watch: Watch,
    /// Whether the world has changed and nothing was refitted since.
    changed: bool,
    outstanding: Option<Outstanding>,
    counters: Counters,
    rng: ChaCha8Rng,
}

impl Trainer {
    /// An untrained network. Same settings, seed and inputs: same weights, bit for bit.
    pub fn new(settings: &Settings, seed: u64) -> Trainer {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let network = Network::random(&mut rng, settings.anchored);
        Trainer {
            settings: *settings,
            at_start: Before { network: network.clone(), last_sample: 0 },
            within: Vec::with_capacity(MOST_SAMPLES),
            watch: Watch::new(&network),
            changed: false,
            network,
            ring: Ring::new(settings.memory, settings.retention),
            coverage: Coverage::default(),
            episode: Episode::default(),
            kept: Vec::with_capacity(settings.kept_per_move as usize),
            of_move: 0,
            outstanding: None,
            counters: Counters::default(),
            rng,
        }
    }

    /// The live network.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// The ring, oldest sample first.
    pub fn samples(&self) -> &[Sample] {
        self.ring.samples()
    }

    /// How often what happened.
    pub fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Standard deviation of what the map says at a (normalised) input, normalised units: see
    /// [`Coverage::doubt`].
    pub fn doubt(&self, input: [f64; 3]) -> f64 {
        self.coverage.doubt(input)
    }

    /// How badly a move is usually foretold: 1 for who has learnt nothing, some hundredths later.
    pub fn usual_surprise(&self) -> f64 {
        self.watch.usual()
    }

    /// Mean error of the live network over the ring, normalised units.
    pub fn error(&self) -> f64 {
        mean_error(&self.network, self.ring.samples(), self.settings.huber)
    }

    /// Another target is there: no pair spans two targets.
    pub fn start_target(&mut self) {
        self.episode.start_target();
    }

    /// A move begins; `start` is what was seen at rest before it.
    pub fn start_move(&mut self, start: Option<View>) {
        self.episode.start_move(start);
        self.at_start.network.clone_from(&self.network);
        self.at_start.last_sample = self.counters.samples;
        self.kept.clear();
        self.within.clear();
        self.of_move = 0;
    }

    /// Learns online from a view during a move: one step of back-propagation for each sample that it
    /// makes with earlier views. Says how wrong the weights were about the motion within this move, as
    /// the mean error relative to the motion; `None` where no sample could be made. No allocation.
    pub fn observe(&mut self, view: View, normalisation: &Normalisation) -> Option<f64> {
        let samples = self.episode.observe(view, normalisation, &self.settings, &mut self.rng);
        let (mut error, mut count) = (0.0, 0u32);
        for (index, sample) in samples.into_iter().enumerate() {
            let Some(mut sample) = sample else { continue };
            self.counters.samples += 1;
            sample.sequence = self.counters.samples;
            if index < SAMPLES_WITHIN_MOVE {
                error += relative_error(&self.network, &sample, FLOOR).min(1.0);
                count += 1;
                if self.within.len() < MOST_SAMPLES {
                    self.within.push(sample);
                }
            }
            self.learn_online(sample);
            self.keep(sample);
        }
        (count > 0).then(|| error / f64::from(count))
    }

    /// Whether enough was seen of the move under way to judge it.
    pub fn can_judge(&self) -> bool {
        surprise(&self.at_start.network, &self.within).is_some()
    }

    /// The move is over: its kept samples go to the ring and a refit becomes due. Where the move shows
    /// that the world has changed, what was learnt before it is brought into the new frame of the image, or
    /// forgotten where no frame explains it.
    pub fn finish_move(&mut self) -> Review {
        let mut review = Review { surprise: None, verdict: Verdict::Same, frame: None };
        if self.settings.detect_change {
            review = self.watch.review(&self.within, &self.at_start);
        }
        if review.verdict == Verdict::Changed {
            self.episode.forget_earlier();
        }
        self.episode.end_move();
        if review.verdict == Verdict::Changed {
            self.begin_anew(review.frame);
        } else {
            if let Some(better) = review.frame {
                self.reframe(better);
            }
            self.kept.sort_by_key(|sample| sample.sequence);
            self.kept.drain(..).for_each(|sample| self.ring.admit(sample));
        }
        self.coverage.take(self.ring.samples());
        self.ask_for_refit();
        review
    }

    /// The move under way taught nothing that can be trusted: as if it had not been made.
    pub fn discard_move(&mut self) {
        self.network.clone_from(&self.at_start.network);
        self.counters.version += 1;
        self.counters.discarded_moves += 1;
        self.kept.clear();
        self.within.clear();
        self.episode.discard_move();
    }

    /// The world has changed. Of what was learnt before, that stays which a new frame explains; of what was
    /// seen since, a fair choice of the samples within moves: a pair across the change is wrong.
    fn begin_anew(&mut self, frame: Option<Frame>) {
        self.counters.changes += 1;
        let last = self.watch.before().last_sample;
        match frame {
            Some(frame) => {
                self.network = self.watch.before().network.seen_through(frame);
                self.counters.version += 1;
                self.ring.forget_after(last);
                self.reframe(frame);
            }
            None => {
                self.ring.forget_after(0);
                self.changed = true;
            }
        }
        self.kept.clear();
        self.of_move = 0;
        for index in 0..self.watch.since().len() {
            let sample = self.watch.since()[index];
            self.keep(sample);
        }
        self.kept.drain(..).for_each(|sample| self.ring.admit(sample));
    }

    /// Brings the samples from before the change out of the frame they are in, into `better`.
    fn reframe(&mut self, better: Frame) {
        let step = self.watch.frame().then(better.inverse());
        self.ring.reframe(step, self.watch.before().last_sample);
        self.watch.set_frame(better);
    }

    /// All joints were read so many seconds too early: brings what is in memory to the right time.
    pub fn retime(&mut self, seconds: f64) {
        self.ring.retime(seconds);
        self.episode.retime(seconds);
    }

    fn ask_for_refit(&mut self) {
        if self.settings.iterations == 0 || self.ring.samples().len() < MIN_REFIT_SAMPLES {
            return;
        }
        self.counters.refits_started += 1;
        let fresh = self.changed.then(|| Network::random(&mut self.rng, self.settings.anchored));
        self.changed = false;
        self.outstanding = Some(Outstanding {
            number: self.counters.refits_started,
            network: self.network.clone(),
            fresh,
            arrived: Vec::new(),
        });
    }

    /// Number of the refit that is due or out: from the end of a move until its result is merged, refused
    /// or overtaken by the next.
    pub fn refit_number(&self) -> Option<u64> {
        self.outstanding.as_ref().map(|outstanding| outstanding.number)
    }

    /// The job behind [`Trainer::refit_number`]: however often it is asked for, also after a restore, the
    /// same to the bit (the ring only changes when a move ends, and then the next job takes its place).
    pub fn refit_job(&self) -> Option<RefitJob> {
        self.outstanding.as_ref().map(|outstanding| RefitJob {
            number: outstanding.number,
            network: outstanding.network.clone(),
            fresh: outstanding.fresh.clone(),
            samples: self.ring.samples().to_vec(),
            huber: self.settings.huber,
            method: self.settings.method,
            iterations: self.settings.iterations,
        })
    }

    /// Makes a refit's result live, if it is the one that is waited for, sound, and better than the live
    /// weights on the ring as it is now. What was learnt online since the job was built is first learnt
    /// by the result too.
    pub fn merge(&mut self, result: &RefitResult) -> Merge {
        let Some(outstanding) = self.outstanding.take_if(|waiting| waiting.number == result.number) else {
            return Merge::Stale;
        };
        let mut candidate = result.network.clone();
        for sample in &outstanding.arrived {
            online_step(&mut candidate, sample, self.settings.eta, self.settings.huber);
        }
        let verdict = self.judge(&candidate);
        if verdict == Merge::Merged {
            self.network = candidate;
            self.counters.version += 1;
            self.counters.refits_merged += 1;
        } else {
            self.counters.refits_rejected += 1;
        }
        verdict
    }

    fn judge(&self, candidate: &Network) -> Merge {
        if !candidate.is_sound() || candidate.anchored() != self.network.anchored() {
            return Merge::Unsound;
        }
        let error = mean_error(candidate, self.ring.samples(), self.settings.huber);
        if error < self.error() { Merge::Merged } else { Merge::NotBetter }
    }

    fn learn_online(&mut self, sample: Sample) {
        online_step(&mut self.network, &sample, self.settings.eta, self.settings.huber);
        self.counters.version += 1;
        if let Some(outstanding) = &mut self.outstanding {
            outstanding.arrived.push(sample);
            if outstanding.arrived.len() > MAX_REPLAYED {
                self.outstanding = None;
                self.counters.refits_rejected += 1;
            }
        }
    }

    /// Reservoir sampling: each sample of the move has the same chance to be kept.
    fn keep(&mut self, sample: Sample) {
        self.of_move += 1;
        if self.kept.len() < self.settings.kept_per_move as usize {
            self.kept.push(sample);
            return;
        }
        let place = self.rng.random_range(0..self.of_move);
        if let Some(kept) = usize::try_from(place).ok().and_then(|place| self.kept.get_mut(place)) {
            *kept = sample;
        }
    }
}

#[cfg(test)]
mod tests;
