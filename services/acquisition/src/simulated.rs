//! The simulated camera: renders what WORLD_STATE says that there is to see.

use crate::camera::{Camera, CameraError, Exposure};
use crate::kept::textures;
use pursuit_bus::{Bus, BusError, Subscriber, wait};
use pursuit_messages::topics::WorldStates;
use pursuit_messages::{SceneKind, WorldState};
use pursuit_runtime::settings::Clock;
use pursuit_scene::{Glare, Kind, Scene, SceneParameters, View};
use std::path::Path;
use std::time::Duration;

/// Renders the world's frames. In lock-step every exposure is rendered, also one that is asked for again;
/// on the wall clock the newest wins.
pub struct SimulatedCamera {
    scene: Scene,
    worlds: Subscriber<WorldStates>,
    clock: Clock,
    due: Option<WorldState>,
}

impl SimulatedCamera {
    /// A camera on the bus; its scene's textures are kept in the file `kept`.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn new(
        bus: &Bus,
        scene: &SceneParameters,
        clock: Clock,
        kept: &Path,
    ) -> Result<SimulatedCamera, BusError> {
        let worlds = bus.subscriber(WorldStates)?;
        let scene = Scene::with_textures(scene, textures(kept, scene));
        Ok(SimulatedCamera { scene, worlds, clock, due: None })
    }

    fn next(&mut self) -> Result<Option<Exposure>, CameraError> {
        let mut found: Option<Exposure> = None;
        while let Some(message) = self.worlds.receive()? {
            let world = message.payload();
            if world.exposes == 0 {
                continue;
            }
            let stamp = message.stamp();
            let skipped = found.map_or(0, |older| older.skipped + 1);
            found =
                Some(Exposure { epoch: stamp.epoch, frame: stamp.frame, time_ns: world.time_ns, skipped });
            self.due = Some(*world);
            if self.clock == Clock::Lockstep {
                break;
            }
        }
        Ok(found)
    }
}

impl Camera for SimulatedCamera {
    fn wait(&mut self, limit: Duration) -> Result<Option<Exposure>, CameraError> {
        if let Some(exposure) = self.next()? {
            return Ok(Some(exposure));
        }
        wait(&[&self.worlds], limit)?;
        self.next()
    }

    fn expose(&mut self, exposure: &Exposure, pixels: &mut [u8]) -> Result<(), CameraError> {
        let Some(world) = self.due.take() else {
            return Err(CameraError::Empty("no world to render".to_owned()));
        };
        let stride = self.scene.parameters().width;
        self.scene
            .render(&view_of(&world, exposure.frame), pixels, stride)
            .map_err(|e| CameraError::View(e.to_string()))
    }
}

/// What the camera sees of a world at the exposure of `frame`.
pub fn view_of(world: &WorldState, frame: u64) -> View {
    let kind = if world.scene == SceneKind::Blob as u32 { Kind::Blob } else { Kind::Vehicle };
    let glare = Glare { centre_px: world.glare_px, radius_px: world.glare_radius_px };
    View {
        camera_position: world.camera_position,
        camera_rotation: world.camera_rotation,
        focal_px: world.focal_px,
        kind,
        target_position: world.target_position,
        target_heading: world.target_heading,
        glare: (world.glares == 1).then_some(glare),
        frame,
        time_ns: world.time_ns,
    }
}
