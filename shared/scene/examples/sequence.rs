//! Writes the frames of a synthetic sequence to look at, and says what is true of them:
//! `cargo run --release -p pursuit-scene --example sequence -- combined 512 1 /tmp/frames` (scenario, side, seed).

use std::fs;
use std::io::Write;
use std::path::Path;
use std::time::Instant;

use pursuit_scene::sequences::{Sequence, hard, with_target, without_target};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument = |i: usize, default: &'static str| arguments.get(i).map_or(default, String::as_str);
    let (name, folder) = (argument(0, "combined"), argument(3, "/tmp/frames"));
    let (size, seed) = (argument(1, "512").parse()?, argument(2, "1").parse()?);
    let all: Vec<_> = with_target().into_iter().chain(hard()).chain(without_target()).collect();
    let Some(scenario) = all.iter().find(|scenario| scenario.name == name) else {
        let names: Vec<&str> = all.iter().map(|scenario| scenario.name).collect();
        return Err(format!("no scenario {name}; there are {}", names.join(", ")).into());
    };
    fs::create_dir_all(folder)?;
    let start = Instant::now();
    let mut sequence = Sequence::new(scenario, size, seed)?;
    println!("prepared in {:.0} ms", start.elapsed().as_secs_f64() * 1e3);
    let mut pixels = vec![0; size * size];
    for t in 0..sequence.frames() {
        let start = Instant::now();
        sequence.render(t, &mut pixels);
        println!("{t}: {:.1} ms, {:.2?}", start.elapsed().as_secs_f64() * 1e3, sequence.truth(t));
        let mut file = fs::File::create(Path::new(folder).join(format!("{name}-{t:02}.pgm")))?;
        write!(file, "P5\n{size} {size}\n255\n")?;
        file.write_all(&pixels)?;
    }
    Ok(())
}
