//! The thread on which batch refits run, one at a time.

use crate::step::Learner;
use pursuit_learning::{RefitJob, RefitResult, refit};
use pursuit_runtime::ServiceError;
use pursuit_runtime::clock::monotonic_ns;
use pursuit_runtime::process::give_way;
use pursuit_runtime::settings::Clock;
use std::cell::Cell;
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::time::Duration;

/// In lock-step a result is waited for this long; a refit takes some milliseconds.
const PATIENCE: Duration = Duration::from_secs(10);

/// On the wall clock the thread computes so long in one go, ns: nobody waits longer for its core.
const SPELL_NS: u64 = 40_000;
/// Then it rests so long (the kernel makes it twice as much).
const PAUSE: Duration = Duration::from_micros(50);

/// Owns the thread. It ends when this is dropped.
pub struct Refitter {
    jobs: SyncSender<RefitJob>,
    results: Receiver<(RefitResult, u64)>,
    /// Number of the job that the thread has.
    running: Option<u64>,
    last_ns: u64,
}

impl Refitter {
    /// Starts the thread. On the wall clock it works in short spells: a frame must not wait for it.
    /// In lock-step everything waits for it.
    ///
    /// # Errors
    /// Where the system has no thread to give.
    pub fn start(clock: Clock) -> std::io::Result<Refitter> {
        let (jobs, job_queue) = sync_channel::<RefitJob>(1);
        let (result_queue, results) = sync_channel(1);
        std::thread::Builder::new().name("refit".to_owned()).spawn(move || {
            if clock == Clock::Wall {
                give_way();
            }
            while let Ok(job) = job_queue.recv() {
                let begin = monotonic_ns();
                let spell = Cell::new(begin);
                let result = refit(&job, || {
                    if clock == Clock::Wall && monotonic_ns() - spell.get() >= SPELL_NS {
                        std::thread::sleep(PAUSE);
                        spell.set(monotonic_ns());
                    }
                    true
                });
                if result_queue.send((result, monotonic_ns() - begin)).is_err() {
                    return;
                }
            }
        })?;
        Ok(Refitter { jobs, results, running: None, last_ns: 0 })
    }

    /// Starts the learner's refit where one is due that is not running.
    pub fn begin(&mut self, learner: &Learner) {
        let due = learner.refit_number();
        if due.is_none() || due == self.running {
            return;
        }
        if let Some(job) = learner.refit_job() {
            let number = job.number;
            if self.jobs.try_send(job).is_ok() {
                self.running = Some(number);
            }
        }
    }

    /// Merges the result where there is one; `waits` for it where a refit is running (lock-step: the
    /// answer to a frame must not depend on how fast the thread was).
    ///
    /// # Errors
    /// Where the thread is dead, or in lock-step so slow that the run would not be reproducible: the
    /// service shall start again from its checkpoint.
    pub fn merge_into(&mut self, learner: &mut Learner, waits: bool) -> Result<(), ServiceError> {
        if self.running.is_none() {
            return Ok(());
        }
        let result = if waits {
            self.results
                .recv_timeout(PATIENCE)
                .map(Some)
                .map_err(|e| format!("no refit in {PATIENCE:?}: {e}"))
        } else {
            match self.results.try_recv() {
                Ok(result) => Ok(Some(result)),
                Err(TryRecvError::Empty) => Ok(None),
                Err(TryRecvError::Disconnected) => Err("the refit thread is dead".to_owned()),
            }
        };
        if let Some((result, spent_ns)) = result.map_err(ServiceError::Other)? {
            self.running = None;
            self.last_ns = spent_ns;
            learner.merge(&result);
        }
        Ok(())
    }

    /// Time that the last refit took, ns.
    pub fn last_ns(&self) -> u64 {
        self.last_ns
    }
}
