//! Independent jobs on several threads.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What `job` gives for 0 to `count` - 1, in this order, worked out on as many threads as there are cores, at
/// most `most_threads`.
///
/// # Errors
/// In words, when a job has left nothing.
pub fn map<T: Send>(
    count: usize,
    most_threads: usize,
    job: impl Fn(usize) -> T + Sync,
) -> Result<Vec<T>, String> {
    let next = AtomicUsize::new(0);
    let results: Mutex<Vec<Option<T>>> = Mutex::new((0..count).map(|_| None).collect());
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(count).min(most_threads);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= count {
                        return;
                    }
                    let result = job(index);
                    if let Ok(mut results) = results.lock() {
                        results[index] = Some(result);
                    }
                }
            });
        }
    });
    let results = results.into_inner().map_err(|_| "a run of the experiment panicked".to_owned())?;
    let all: Option<Vec<T>> = results.into_iter().collect();
    all.ok_or_else(|| "a run of the experiment was left out".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_the_order_of_their_numbers() {
        assert_eq!(map(100, 4, |k| k * k), Ok((0..100).map(|k| k * k).collect::<Vec<_>>()));
        assert_eq!(map(0, 4, |k| k), Ok(Vec::new()));
    }
}
