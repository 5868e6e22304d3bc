//! A camera with a fault, for tests of the rest: PX4's words for what can fail, and how.
//!
//! Where the config allows it (`acquisition.faults`), a word in the file `camera.fault` of the run-time directory is
//! what the camera has; without the file it is well.

use crate::camera::{Camera, CameraError, Exposure};
use pursuit_runtime::clock::monotonic_ns;
use std::path::PathBuf;
use std::time::Duration;

/// Delay of a delayed camera, ns.
const DELAY_NS: u64 = 300_000_000;
/// A slow camera gives one of so many frames, an intermittent one leaves about half of them out.
const SLOW: u64 = 4;

/// What a camera can have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// It gives nothing.
    Off,
    /// It gives the same image again and again, with fresh stamps.
    Stuck,
    /// Its pixels are noise.
    Garbage,
    /// Its images are upside down.
    Wrong,
    /// It gives a quarter of its frames.
    Slow,
    /// It gives its frames 0.3 s late.
    Delayed,
    /// It leaves frames out.
    Intermittent,
    /// It sees nothing.
    Black,
    /// It sees only light.
    White,
    /// Something is before its lens.
    Covered,
}

impl Fault {
    /// All, with their words.
    pub const ALL: [(&'static str, Fault); 10] = [
        ("off", Fault::Off),
        ("stuck", Fault::Stuck),
        ("garbage", Fault::Garbage),
        ("wrong", Fault::Wrong),
        ("slow", Fault::Slow),
        ("delayed", Fault::Delayed),
        ("intermittent", Fault::Intermittent),
        ("black", Fault::Black),
        ("white", Fault::White),
        ("covered", Fault::Covered),
    ];

    /// The one with that word.
    pub fn from_word(word: &str) -> Option<Fault> {
        Fault::ALL.into_iter().find(|(known, _)| *known == word.trim()).map(|(_, fault)| fault)
    }
}

/// A camera that can be told to fail.
pub struct FaultyCamera {
    camera: Box<dyn Camera>,
    file: PathBuf,
    fault: Option<Fault>,
    held: Option<Exposure>,
    stuck: Vec<u8>,
}

impl FaultyCamera {
    /// `camera` with the fault that `file` says.
    pub fn new(camera: Box<dyn Camera>, file: PathBuf) -> FaultyCamera {
        FaultyCamera { camera, file, fault: None, held: None, stuck: Vec::new() }
    }

    fn lets_pass(&self, exposure: &Exposure) -> bool {
        match self.fault {
            Some(Fault::Off) => false,
            Some(Fault::Slow) => exposure.frame.is_multiple_of(SLOW),
            Some(Fault::Intermittent) => scrambled(exposure.frame) & 1 == 0,
            _ => true,
        }
    }
}

impl Camera for FaultyCamera {
    fn wait(&mut self, limit: Duration) -> Result<Option<Exposure>, CameraError> {
        self.fault = std::fs::read_to_string(&self.file).ok().and_then(|word| Fault::from_word(&word));
        if self.held.is_none() {
            self.held = self.camera.wait(limit)?;
        } else {
            std::thread::sleep(limit.min(Duration::from_millis(1)));
        }
        let is_late = self.fault == Some(Fault::Delayed);
        let Some(exposure) = self.held.filter(|held| !is_late || monotonic_ns() >= held.time_ns + DELAY_NS)
        else {
            return Ok(None);
        };
        self.held = None;
        Ok(Some(exposure).filter(|exposure| self.lets_pass(exposure)))
    }

    fn expose(&mut self, exposure: &Exposure, pixels: &mut [u8]) -> Result<(), CameraError> {
        self.camera.expose(exposure, pixels)?;
        match self.fault {
            Some(Fault::Stuck) if self.stuck.len() == pixels.len() => pixels.copy_from_slice(&self.stuck),
            Some(Fault::Stuck) => self.stuck = pixels.to_vec(),
            Some(Fault::Garbage) => noise(pixels, exposure.frame, 0, u8::MAX),
            Some(Fault::Wrong) => pixels.reverse(),
            // The sensor's noise stays: such a camera does not repeat itself.
            Some(Fault::Black) => noise(pixels, exposure.frame, 0, 3),
            Some(Fault::White) => noise(pixels, exposure.frame, 252, 3),
            Some(Fault::Covered) => noise(pixels, exposure.frame, 60, 3),
            _ => {}
        }
        if self.fault != Some(Fault::Stuck) {
            self.stuck.clear();
        }
        Ok(())
    }
}

/// Grey levels from `least` on, over those that `mask` lets through; others in each frame.
fn noise(pixels: &mut [u8], frame: u64, least: u8, mask: u8) {
    let mut state = frame;
    for pixel in pixels.iter_mut() {
        state = scrambled(state);
        *pixel = least + (state as u8 & mask);
    }
}

/// One step of a well-known generator (splitmix64).
fn scrambled(number: u64) -> u64 {
    let mixed = number.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    mixed ^ (mixed >> 31)
}
