//! Makes the example of `pursuit detect`: a camera pans over a cluttered table on which a vehicle drives
//! that wears the table's pattern. Writes PNG files and `truth.json` (the vehicle's centre in each frame).
//!
//! ```sh
//! cargo run --release -p pursuit-images --example camouflage -- tests/data/camouflage
//! ```

use pursuit_images::write_png_grey;
use pursuit_scene::{Kind, Scene, SceneParameters, View};
use std::path::Path;

const FRAMES: usize = 12;
const WIDTH: usize = 320;
const HEIGHT: usize = 256;
const FOCAL_PX: f64 = 200.0;
const HEIGHT_M: f64 = 0.5;
/// Of the vehicle's roof, from which the truth is taken.
const ROOF_M: f64 = 0.06;
/// Per frame, m: the camera pans, the vehicle drives another way.
const CAMERA_STEP_M: [f64; 2] = [0.008, -0.004];
const VEHICLE_STEP_M: [f64; 2] = [-0.006, 0.009];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).ok_or("usage: camouflage FOLDER")?;
    std::fs::create_dir_all(&folder)?;
    let parameters =
        SceneParameters { seed: 1994, width: WIDTH, height: HEIGHT, ..SceneParameters::default() };
    let mut scene = Scene::new(&parameters);
    let mut pixels = vec![0; WIDTH * HEIGHT];
    let mut truth = Vec::new();
    for frame in 0..FRAMES {
        let along = |start: [f64; 2], step: [f64; 2]| [0, 1].map(|k| start[k] + step[k] * frame as f64);
        let camera = along([0.58, -0.02], CAMERA_STEP_M);
        let vehicle = along([0.66, -0.10], VEHICLE_STEP_M);
        let view = View {
            target_position: vehicle,
            target_heading: VEHICLE_STEP_M[1].atan2(VEHICLE_STEP_M[0]),
            frame: frame as u64,
            focal_px: FOCAL_PX,
            ..View::looking_down([camera[0], camera[1], HEIGHT_M], 0.0, Kind::Vehicle)
        };
        scene.render(&view, &mut pixels, WIDTH)?;
        let name = format!("f{frame:02}.png");
        write_png_grey(&Path::new(&folder).join(&name), WIDTH as u32, HEIGHT as u32, &pixels)?;
        let scale = FOCAL_PX / (HEIGHT_M - ROOF_M);
        // The camera looks down: the image's x is the table's x, its y the table's -y.
        let u = (WIDTH as f64 - 1.0) / 2.0 + scale * (vehicle[0] - camera[0]);
        let v = (HEIGHT as f64 - 1.0) / 2.0 - scale * (vehicle[1] - camera[1]);
        truth.push(format!("  {{\"file\": \"{name}\", \"u\": {u:.2}, \"v\": {v:.2}}}"));
    }
    std::fs::write(Path::new(&folder).join("truth.json"), format!("[\n{}\n]\n", truth.join(",\n")))?;
    Ok(())
}
