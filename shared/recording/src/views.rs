//! What viewers plot: the numbers of a message as JSON, and the description of these objects.

use crate::entry::Sample;
use pursuit_messages::Detection;
use std::fmt::Write as _;

/// The topics with numbers.
pub const NAMES: [&str; 5] = ["target", "joints", "setpoint", "learner", "arm"];

/// A JSON schema that Foxglove takes; the fields are in the messages themselves.
pub const SCHEMA: &[u8] = b"{\"type\":\"object\"}";

/// Index into [`NAMES`] and the object; `None` for what has no numbers to plot.
pub fn numbers(sample: &Sample, out: &mut String) -> Option<usize> {
    out.clear();
    out.push('{');
    let index = match sample {
        Sample::Target(target) => {
            detection("motion", &target.motion, out);
            detection("track", &target.track, out);
            detection("blob", &target.blob, out);
            field("track_phase", f64::from(target.track_phase), out);
            list("background_px_per_frame", &[target.background_u, target.background_v], out);
            0
        }
        Sample::Joints(joints) => {
            list("position_rad", &joints.position, out);
            list("velocity_rad_per_s", &joints.velocity, out);
            field("following", f64::from(joints.following), out);
            field("refusal", f64::from(joints.refusal), out);
            1
        }
        Sample::SetPoint(point) => {
            field("follow", f64::from(point.follow), out);
            field("phase", f64::from(point.phase), out);
            list("position_rad", &point.position, out);
            list("velocity_rad_per_s", &point.velocity, out);
            field("moves", f64::from(point.moves), out);
            2
        }
        Sample::Learner(state) => {
            field("phase", f64::from(state.phase), out);
            field("moves", f64::from(state.moves), out);
            field("samples", state.samples as f64, out);
            field("loss", state.loss, out);
            field("surprise", state.surprise, out);
            field("uncertainty_rad", state.uncertainty_rad, out);
            field("lead_ms", state.lead_ns as f64 * 1e-6, out);
            field("changes", f64::from(state.changes), out);
            3
        }
        Sample::Driver(state) => {
            field("state", f64::from(state.state), out);
            field("cause", f64::from(state.cause), out);
            field("at_rest", f64::from(state.at_rest), out);
            field("refusal", f64::from(state.refusal), out);
            4
        }
        _ => return None,
    };
    if out.ends_with(',') {
        out.pop();
    }
    out.push('}');
    Some(index)
}

fn detection(name: &str, found: &Detection, out: &mut String) {
    let _ = write!(out, "\"{name}\":{{");
    field("found", f64::from(found.found), out);
    let values = [("u", found.u), ("v", found.v), ("vu", found.vu), ("vv", found.vv)];
    // A plot of where nothing is would be a line at 0.
    let values = values.into_iter().chain([("confidence", found.confidence), ("area_px", found.area_px)]);
    values.filter(|_| found.found == 1).for_each(|(name, value)| field(name, value, out));
    out.pop();
    out.push_str("},");
}

fn field(name: &str, value: f64, out: &mut String) {
    let _ = write!(out, "\"{name}\":");
    json(value, out);
    out.push(',');
}

fn list(name: &str, values: &[f64], out: &mut String) {
    let _ = write!(out, "\"{name}\":[");
    for (k, value) in values.iter().enumerate() {
        if k > 0 {
            out.push(',');
        }
        json(*value, out);
    }
    out.push_str("],");
}

/// JSON knows no infinity and no NaN.
fn json(value: f64, out: &mut String) {
    let _ = if value.is_finite() { write!(out, "{value}") } else { write!(out, "null") };
}
