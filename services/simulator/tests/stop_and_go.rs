//! The vehicle that stops and goes, from its config to the truth of the frames.
#![allow(clippy::unwrap_used)]

mod support;

use pursuit_config::{Checker, Document};
use pursuit_messages::Phase;
use pursuit_simulator::config::Config;
use support::{PERIOD_NS, Run};

#[test]
fn the_configured_vehicle_stands_and_drives_by_turns() {
    let text = "[camera]\nrate_hz = 25.0\n[vehicle]\npath = \"stop-and-go\"\ngo_s = 2.0\nstop_s = 4.0\nspeed_m_per_s = 0.2\n";
    let document = Document::parse("test.toml", text).unwrap();
    let config = Config::read(&Checker::new(&document));
    assert_eq!(config.cell.frame_period_ns, PERIOD_NS);
    let mut run = Run::new(&config.cell);
    // 14 s: two periods of 7 s.
    let speeds: Vec<f64> = (0..350)
        .map(|_| {
            let [vx, vy] = run.state().target_velocity;
            run.frame(&support::in_phase(Phase::Tracking));
            vx.hypot(vy)
        })
        .collect();
    let places: Vec<[f64; 2]> = run.records.iter().map(|record| record.target_m).collect();
    for period in [0, 175] {
        // At 1.8 s of a period it drives, from 5 to 6.3 s it stands.
        assert!(speeds[period + 45] > 0.17, "{}", speeds[period + 45]);
        let rest = period + 125..period + 158;
        assert!(rest.clone().all(|frame| speeds[frame] == 0.0 && places[frame] == places[rest.start]));
    }
    assert!(places[125] != places[300]);
}
