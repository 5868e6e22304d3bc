//! Writes frames to look at: `cargo run --release -p pursuit-scene --example look -- /tmp/frames`.

use std::fs;
use std::io::{self, Write};
use std::path::Path;

use pursuit_scene::{Kind, Scene, SceneParameters, View};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let folder = std::env::args().nth(1).unwrap_or_else(|| "/tmp/frames".into());
    fs::create_dir_all(&folder)?;
    let parameters = SceneParameters::default();
    let mut scene = Scene::new(&parameters);
    let mut frame = |view: &View| -> Result<Vec<u8>, pursuit_scene::ViewError> {
        let mut pixels = vec![0; 512 * 512];
        scene.render(view, &mut pixels, 512)?;
        Ok(pixels)
    };
    let mut view = View::looking_down([0.6, 0.0, 0.5], 0.3, Kind::Vehicle);
    view.target_position = [0.66, 0.08];
    view.target_heading = 0.7;
    let first = frame(&view)?;
    // the camera moves 5 mm, the vehicle 4 mm in another direction
    view.camera_position[0] += 0.005;
    view.target_position[1] += 0.004;
    view.frame = 1;
    let second = frame(&view)?;
    view.kind = Kind::Blob;
    let blob = frame(&view)?;
    let difference: Vec<u8> =
        first.iter().zip(&second).map(|(a, b)| a.abs_diff(*b).saturating_mul(3)).collect();
    let mut tilted = View::looking_down([0.6, 0.0, 0.5], 0.0, Kind::Vehicle);
    tilted.camera_rotation = [0.82, 0.0, 0.57236, 0.0];
    tilted.target_position = [0.9, 0.1];
    let tilted = frame(&tilted)?;
    for (name, pixels) in
        [("first", first), ("second", second), ("difference", difference), ("blob", blob), ("tilted", tilted)]
    {
        write_pgm(&Path::new(&folder).join(format!("{name}.pgm")), &pixels)?;
    }
    Ok(())
}

fn write_pgm(path: &Path, pixels: &[u8]) -> io::Result<()> {
    let mut file = fs::File::create(path)?;
    file.write_all(b"P5\n512 512\n255\n")?;
    file.write_all(pixels)
}
