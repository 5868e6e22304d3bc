//! The textures of a scene: what takes long to make, and what may be kept for the next process.

use crate::levels::Levels;
use crate::parameters::SceneParameters;
use crate::random::Random;
use crate::texture::{self, SMALLEST_TORUS_M, Torus};

/// The cloth's texture repeats after this many texels, at most.
const CLOTH_TEXELS: usize = 1024;

/// Streams of the seed.
const TABLE_STREAM: u64 = 1;
const VEHICLE_STREAM: u64 = 2;
const CLOTH_STREAM: u64 = 3;

/// Table, vehicle and cloth, painted and filtered.
pub struct Textures {
    pub(crate) table: Levels,
    pub(crate) vehicle: Levels,
    pub(crate) cloth: Levels,
}

impl Textures {
    /// Paints and filters: nearly all the time that [`Scene::new`](crate::Scene::new) takes.
    pub fn paint(parameters: &SceneParameters) -> Textures {
        let SceneParameters { seed, texel_m, contrast_sd, .. } = *parameters;
        let [_, vehicle, cloth] = sides(parameters);
        let vehicle = texture::camouflage(vehicle, texel_m, contrast_sd, Random::new(seed, VEHICLE_STREAM));
        let cloth = texture::cloth(cloth, texel_m, Random::new(seed, CLOTH_STREAM));
        let levels = |torus| Levels::new(&torus, texel_m, parameters.profile.prefilter_texels());
        Textures {
            table: levels(Textures::painted_table(parameters)),
            vehicle: levels(vehicle),
            cloth: levels(cloth),
        }
    }

    /// The table before it is filtered.
    pub(crate) fn painted_table(parameters: &SceneParameters) -> Torus {
        let random = Random::new(parameters.seed, TABLE_STREAM);
        texture::camouflage(parameters.texture_texels, parameters.texel_m, parameters.contrast_sd, random)
    }

    /// What [`Textures::from_bytes`] makes the same textures of: a line that says of which parameters they were
    /// painted, and their grey levels.
    pub fn to_bytes(&self, parameters: &SceneParameters) -> Vec<u8> {
        let mut bytes = heading(parameters).into_bytes();
        [&self.table, &self.vehicle, &self.cloth].into_iter().for_each(|levels| bytes.extend(levels.grey()));
        bytes
    }

    /// The textures in `bytes`; nothing if they were painted of other parameters, or are not whole.
    pub fn from_bytes(parameters: &SceneParameters, bytes: &[u8]) -> Option<Textures> {
        let mut grey = bytes.strip_prefix(heading(parameters).as_bytes())?;
        let sides = sides(parameters);
        if grey.len() != sides.into_iter().map(Levels::grey_len).sum::<usize>() {
            return None;
        }
        let prefilter = parameters.profile.prefilter_texels();
        let [table, vehicle, cloth] = sides.map(|side| {
            let (first, rest) = grey.split_at(Levels::grey_len(side));
            grey = rest;
            Levels::from_grey(side, first, parameters.texel_m, prefilter)
        });
        Some(Textures { table, vehicle, cloth })
    }
}

/// Texels per side of table, vehicle and cloth.
fn sides(parameters: &SceneParameters) -> [usize; 3] {
    let table = parameters.texture_texels;
    [table, vehicle_texels(parameters), CLOTH_TEXELS.min(table)]
}

/// All that decides the textures.
fn heading(parameters: &SceneParameters) -> String {
    let SceneParameters { seed, texel_m, contrast_sd, profile, .. } = parameters;
    format!("textures {:?} {seed} {texel_m:?} {contrast_sd:?} {profile:?}\n", sides(parameters))
}

/// Texels per side for the vehicle: the unfolded box and a margin, a power of two.
fn vehicle_texels(parameters: &SceneParameters) -> usize {
    let [length, width, height] = parameters.vehicle_size_m;
    let unfolded = length.max(width) + 2.0 * height;
    let least = (1.2 * unfolded).max(1.5 * SMALLEST_TORUS_M) / parameters.texel_m;
    (least as usize).next_power_of_two()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn textures_that_were_kept_are_those_that_were_painted() {
        let parameters = SceneParameters { texture_texels: 512, ..SceneParameters::default() };
        let painted = Textures::paint(&parameters);
        let bytes = painted.to_bytes(&parameters);
        let kept = Textures::from_bytes(&parameters, &bytes).unwrap();
        let pairs =
            [(&painted.table, &kept.table), (&painted.vehicle, &kept.vehicle), (&painted.cloth, &kept.cloth)];
        for (painted, kept) in pairs {
            for distance in [0.2, 0.5, 1.0, 2.0, 5.0] {
                let (painted, kept) = (painted.choose(distance / 256.0), kept.choose(distance / 256.0));
                assert_eq!(painted.level.quads, kept.level.quads);
                assert_eq!(
                    (painted.level.side, painted.level.texel_m),
                    (kept.level.side, kept.level.texel_m)
                );
                assert_eq!(painted.blend.map(|(_, share)| share), kept.blend.map(|(_, share)| share));
            }
        }
    }

    #[test]
    fn textures_of_other_parameters_or_cut_short_are_none() {
        let parameters = SceneParameters { texture_texels: 256, ..SceneParameters::default() };
        let bytes = Textures::paint(&parameters).to_bytes(&parameters);
        assert!(Textures::from_bytes(&SceneParameters { seed: 2, ..parameters.clone() }, &bytes).is_none());
        let larger = SceneParameters { texture_texels: 512, ..parameters.clone() };
        assert!(Textures::from_bytes(&larger, &bytes).is_none());
        for length in [0, 10, bytes.len() / 2, bytes.len() - 1] {
            assert!(Textures::from_bytes(&parameters, &bytes[..length]).is_none(), "{length} bytes");
        }
        assert!(Textures::from_bytes(&parameters, &bytes).is_some());
    }
}
