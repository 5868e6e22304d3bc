//! Observer: sees everything, and tells the loop nothing.
//!
//! It looks at all topics from time to time ([`ears`]); nobody wakes it, waits for it or reads what it makes.
//! It keeps an [`account`] of all frames: what became of each ([`ledger`]), and where its time went
//! ([`latency`]).

#![cfg_attr(test, allow(clippy::unwrap_used))]

pub mod account;
pub mod actions;
pub mod config;
pub mod dossier;
pub mod ears;
pub mod endpoint;
pub mod histogram;
pub mod latency;
pub mod ledger;
pub mod metrics;
pub mod otlp;
pub mod page;
pub mod summary;
pub mod timeline;

use account::Account;
use actions::Action;
use config::Config;
use dossier::Dossiers;
use ears::{Ears, Heard};
use endpoint::{Answer, Site};
use otlp::Exporter;
use page::Live;
use pursuit_bus::{Bus, Instance};
use pursuit_config::{Checker, Document, Scope};
use pursuit_runtime::clock::{monotonic_ns, sleep_until_ns};
use pursuit_runtime::settings::Clock;
use pursuit_runtime::{ServiceError, Station, place};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Runs until stopped.
///
/// # Errors
/// [`ServiceError`] for a wrong config or a bus that fails.
pub fn run(mut station: Station) -> Result<(), ServiceError> {
    let config = station.config(Config::read)?;
    let ears = Ears::open(&station.bus)?;
    let look_ns = config.look().as_nanos() as u64;
    let told = Arc::new(Told {
        account: Mutex::new(Account::new(config.run.clock == Clock::Wall)),
        dossiers: Mutex::default(),
        live: Mutex::default(),
        directory: station.directory().to_owned(),
    });
    if !station.take_over()? {
        return Ok(());
    }
    if let Some(address) = config.metrics {
        serve(address, &told, station.directory());
    }
    let exporter = config.otlp.as_deref().map(|collector| Exporter::start(collector, config.otlp_every));
    let mut exporter =
        exporter.transpose().map_err(|e| ServiceError::Other(format!("no thread for traces: {e}")))?;
    let mut failures = 0;
    let (mut newest, mut alarmed) = (None, false);
    while station.turn() {
        let begin = monotonic_ns();
        let (mut account, mut dossiers) = (unpoisoned(&told.account), unpoisoned(&told.dossiers));
        let mut live = unpoisoned(&told.live);
        let watched = live.is_watched(begin);
        failures += account.listen_with(&ears, |heard| {
            dossiers.take(heard);
            if let (Some(exporter), Heard::Command(stamp, _)) = (&mut exporter, heard)
                && account::is_answer(stamp)
            {
                exporter.take(stamp);
            }
            if watched {
                live.take(heard);
            }
        });
        if account.newest() != newest
            && let Some((_, frame)) = account.newest()
        {
            newest = account.newest();
            station.answered(frame);
        }
        if account.mismatches > 0 && !alarmed {
            alarmed = true;
            tracing::error!(sums = ?account.sums(), "the account of the frames does not add up");
        }
        drop((account, dossiers, live));
        station.health.refused = ears.refused() + failures;
        sleep_until_ns(begin + look_ns);
    }
    Ok(())
}

/// What can be asked for over HTTP. Where several are locked, in this order.
struct Told {
    account: Mutex<Account>,
    dossiers: Mutex<Dossiers>,
    live: Mutex<Live>,
    directory: PathBuf,
}

impl Site for Arc<Told> {
    fn page(&self, path: &str) -> Option<Answer> {
        let plain = |text| Answer::text("text/plain; version=0.0.4", text);
        match path {
            "/metrics" => Some(plain(metrics::exposition(&unpoisoned(&self.account)))),
            "/live" => {
                let account = unpoisoned(&self.account);
                Some(unpoisoned(&self.live).answer(&account, monotonic_ns()))
            }
            _ => Live::file(path).or_else(|| {
                let frame = path.strip_prefix("/frames/")?.parse().ok()?;
                Some(plain(unpoisoned(&self.dossiers).page(frame).unwrap_or_else(|none| none)))
            }),
        }
    }

    fn action(&self, path: &str) -> Option<Action> {
        Action::of(path)
    }

    fn done(&self, action: Action) -> Result<(), String> {
        tracing::info!(?action, "asked for from the live page");
        action.done(&self.directory)
    }

    fn token(&self) -> Option<String> {
        std::fs::read_to_string(self.directory.join(place::TOKEN)).ok()
    }
}

fn unpoisoned<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A port in use is no reason not to observe: it is said, with the way out.
fn serve(address: SocketAddr, told: &Arc<Told>, directory: &Path) {
    let told = Arc::clone(told);
    let bound = endpoint::serve(address, told).and_then(|bound| {
        std::fs::write(directory.join(place::OBSERVER), bound.to_string())?;
        Ok(bound)
    });
    match bound {
        Ok(bound) => tracing::info!("live page at http://{bound}/, metrics at http://{bound}/metrics"),
        Err(error) => tracing::warn!(
            "no live page and no metrics at {address} ({error}): choose another address with --set observer.metrics=127.0.0.1:PORT"
        ),
    }
}

/// One more reader of a running instance, for a verb that looks at it.
pub struct Watch {
    /// What has been heard.
    pub account: Account,
    ears: Ears,
    look_ns: u64,
    /// Last, so that it outlives its readers.
    _bus: Bus,
}

impl Watch {
    /// Joins the instance in `directory`.
    ///
    /// # Errors
    /// [`ServiceError`] where there is no config of a run, or the bus fails.
    pub fn join(directory: &Path) -> Result<Watch, ServiceError> {
        let document = Document::load(&directory.join(place::CONFIG))?;
        let checker = Checker::new(&document);
        let config = Config::read(&checker);
        checker.finish(Scope::ReadKeys)?;
        let bus = Bus::join(&Instance::at(directory)?, "trace")?;
        let ears = Ears::open(&bus)?;
        let account = Account::new(config.run.clock == Clock::Wall);
        Ok(Watch { account, ears, look_ns: config.look().as_nanos() as u64, _bus: bus })
    }

    /// Listens for `duration`.
    pub fn keep_watching(&mut self, duration: Duration) {
        let end = monotonic_ns() + duration.as_nanos() as u64;
        loop {
            let now = monotonic_ns();
            self.account.listen(&self.ears);
            if now >= end {
                return;
            }
            sleep_until_ns((now + self.look_ns).min(end));
        }
    }
}

/// The account of the running instance in `directory` over `duration`.
///
/// # Errors
/// As [`Watch::join`].
pub fn observe(directory: &Path, duration: Duration) -> Result<Account, ServiceError> {
    let mut watch = Watch::join(directory)?;
    watch.keep_watching(duration);
    watch.account.finish();
    Ok(watch.account)
}
