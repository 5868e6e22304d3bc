//! Prints the CPU time of one step of the world, for both profiles.
//!
//! `cargo run --release -p pursuit-world --example step_time`. CPU time of the thread, from Linux's
//! `/proc/thread-self/schedstat`: the wall clock of a shared machine says little.

use pursuit_world::{
    FAST_SUBSTEPS, HARDWARE_SUBSTEPS, STEP_NS, TimedCycle, VehiclePose, World, WorldParameters,
};
use std::error::Error;

const STEPS_PER_BATCH: u64 = 1000;
const BATCHES: u64 = 10;

fn cpu_ns() -> Result<u64, Box<dyn Error>> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat")?;
    Ok(text.split_whitespace().next().ok_or("empty schedstat")?.parse()?)
}

fn main() -> Result<(), Box<dyn Error>> {
    for substeps in [FAST_SUBSTEPS, HARDWARE_SUBSTEPS] {
        let parameters = WorldParameters { substeps, ..WorldParameters::starting_at([0.0, 0.6], 0.5)? };
        let mut world = World::new(&parameters)?;
        let mut batches_us = Vec::new();
        for batch in 1..=BATCHES {
            // Joint 1 swings to and fro: one cycle per batch.
            let due_ns = batch * STEPS_PER_BATCH * STEP_NS;
            let mut position = parameters.start_rad;
            position[0] += if batch % 2 == 0 { 0.0 } else { 0.5 };
            let duration_ns = STEPS_PER_BATCH * STEP_NS;
            world.accept(&[TimedCycle { due_ns, duration_ns, position, velocity: [0.0; 6] }])?;
            let begin_ns = cpu_ns()?;
            world.step_until(due_ns, |_| VehiclePose { x_m: 0.63, y_m: 0.2, heading_rad: 0.0 })?;
            batches_us.push((cpu_ns()? - begin_ns) as f64 / 1e3 / STEPS_PER_BATCH as f64);
        }
        batches_us.sort_by(f64::total_cmp);
        let (least, median) = (batches_us[0], batches_us[batches_us.len() / 2]);
        println!("{substeps} substeps: {least:.1} us least, {median:.1} us median per step");
    }
    Ok(())
}
