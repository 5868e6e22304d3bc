//! The paper's figures 2 and 4 of any frame.

use pursuit_images::{Canvas, GreyImage};

use super::detector::{SCALES, VoteField};
use super::sheet::{Panel, sheet};

/// Nothing: no votes, no change.
const GREY: u8 = 128;
/// The side of a cell in figure 4, where the picture does not become too large by it.
const CELL_PX: usize = 8;
/// The longer side of a picture in figure 2 and of a field in figure 4 is at most so long.
const LONGEST_PX: usize = 512;
/// The longer side of a picture in figure 2 is at least so long.
const SHORTEST_PX: usize = 128;

/// The 12 vote fields as in the paper's figure 4: grey where there are no votes, white for the nominal
/// velocity, black for its opposite, all in one scale. A row for each spatial scale.
pub fn figure4(fields: &[VoteField<'_>]) -> Canvas {
    let most = largest(fields.iter().flat_map(|field| field.votes).map(|&vote| f64::from(vote)));
    let panels: Vec<Panel> = fields
        .iter()
        .map(|field| {
            let [vu, vv] = field.velocity;
            let rows = field.votes.len() / field.columns;
            let cells = GreyImage {
                width: field.columns as u32,
                height: rows as u32,
                pixels: field.votes.iter().map(|&vote| signed(f64::from(vote), most)).collect(),
            };
            let cell = (LONGEST_PX / field.columns.max(rows)).clamp(1, CELL_PX);
            let picture = resized(&cells, (cell * field.columns, cell * rows));
            Panel { title: format!("{}  v=({vu:.0},{vv:.0})", field.label), picture }
        })
        .collect();
    sheet(&panels, "white: votes for v (px/frame), black: for -v, grey: none")
}

/// The paper's figure 2 of one frame after the other.
#[derive(Default)]
pub struct Figure2 {
    frame: u64,
    levels_before: Option<[GreyImage; SCALES]>,
}

impl Figure2 {
    /// Above the frame and its pyramid's levels, enlarged to its size; below the frame before and what changed
    /// since on each level (the temporal derivative), grey where nothing did, white where it is brighter, all in
    /// one scale. Grey stands for what there is not.
    pub fn draw(
        &mut self,
        (before, frame): (Option<&GreyImage>, &GreyImage),
        levels: Option<[GreyImage; SCALES]>,
    ) -> Canvas {
        let size = panel_size(frame.width as usize, frame.height as usize);
        let blank =
            || GreyImage { width: size.0 as u32, height: size.1 as u32, pixels: vec![GREY; size.0 * size.1] };
        let scale_of = |k: usize| 1 << k;
        let mut panels = vec![Panel { title: format!("frame {}", self.frame), picture: shrunk(frame, size) }];
        for k in 0..SCALES {
            let picture = levels.as_ref().map_or_else(blank, |levels| shrunk(&levels[k], size));
            panels.push(Panel { title: format!("scale {}", scale_of(k)), picture });
        }
        let title = before.map_or_else(String::new, |_| format!("frame {}", self.frame - 1));
        panels.push(Panel { title, picture: before.map_or_else(blank, |before| shrunk(before, size)) });
        let changes =
            self.levels_before.as_ref().zip(levels.as_ref()).map(|(before, now)| changes(before, now));
        for k in 0..SCALES {
            let picture = changes.as_ref().map_or_else(blank, |changes| shrunk(&changes[k], size));
            panels.push(Panel { title: format!("change, scale {}", scale_of(k)), picture });
        }
        let caption = match levels {
            Some(_) => "change: white where the newer frame is brighter, grey: none",
            None => "this detector does not show its pyramid",
        };
        self.frame += 1;
        self.levels_before = levels;
        sheet(&panels, caption)
    }
}

/// Newer minus older on each level.
fn changes(before: &[GreyImage; SCALES], now: &[GreyImage; SCALES]) -> [GreyImage; SCALES] {
    let differences: [Vec<f64>; SCALES] = std::array::from_fn(|k| {
        let pairs = now[k].pixels.iter().zip(&before[k].pixels);
        pairs.map(|(&now, &before)| f64::from(now) - f64::from(before)).collect()
    });
    let most = largest(differences.iter().flatten().copied());
    std::array::from_fn(|k| {
        let pixels = differences[k].iter().map(|&change| signed(change, most)).collect();
        GreyImage { width: now[k].width, height: now[k].height, pixels }
    })
}

fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |most, value| most.max(value.abs()))
}

/// `most` is white, its negative black, 0 [`GREY`].
fn signed(value: f64, most: f64) -> u8 {
    let share = if most > 0.0 { value / most } else { 0.0 };
    (f64::from(GREY) + 127.0 * share).round() as u8
}

/// The size of a picture of a frame in figure 2: its own, divided or multiplied by a whole number.
fn panel_size(width: usize, height: usize) -> (usize, usize) {
    let longer = width.max(height);
    let (up, down) = (SHORTEST_PX.div_ceil(longer), longer.div_ceil(LONGEST_PX));
    ((width * up / down).max(1), (height * up / down).max(1))
}

/// Each pixel the one that lies there.
fn resized(image: &GreyImage, (width, height): (usize, usize)) -> GreyImage {
    let (columns, rows) = (image.width as usize, image.height as usize);
    let row = |y: usize| &image.pixels[y * rows / height * columns..][..columns];
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| row(y)[x * columns / width]));
    GreyImage { width: width as u32, height: height as u32, pixels: pixels.collect() }
}

/// As [`resized`], but where pixels fall together their mean: fine texture would become another one.
fn shrunk(image: &GreyImage, (width, height): (usize, usize)) -> GreyImage {
    let (columns, rows) = (image.width as usize, image.height as usize);
    if width >= columns && height >= rows {
        return resized(image, (width, height));
    }
    let part = |at: usize, of: usize, side: usize| {
        let first = at * side / of;
        first..((at + 1) * side / of).max(first + 1)
    };
    let mean = |x: usize, y: usize| {
        let (xs, ys) = (part(x, width, columns), part(y, height, rows));
        let count = xs.len() * ys.len();
        let sum: usize =
            ys.flat_map(|v| &image.pixels[v * columns..][xs.clone()]).map(|&value| usize::from(value)).sum();
        ((sum + count / 2) / count) as u8
    };
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| mean(x, y));
    GreyImage { width: width as u32, height: height as u32, pixels: pixels.collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(width: u32, height: u32) -> GreyImage {
        GreyImage { width, height, pixels: (0..width * height).map(|k| (k % 251) as u8).collect() }
    }

    #[test]
    fn no_vote_is_grey_and_the_strongest_is_white_or_black() {
        assert_eq!([-2.0, 0.0, 1.0, 2.0].map(|vote| signed(vote, 2.0)), [1, 128, 192, 255]);
        assert_eq!(signed(0.0, 0.0), GREY);
    }

    #[test]
    fn a_picture_is_a_whole_multiple_or_part_of_the_frame() {
        assert_eq!(panel_size(64, 64), (128, 128));
        assert_eq!(panel_size(65, 97), (130, 194));
        assert_eq!(panel_size(320, 256), (320, 256));
        assert_eq!(panel_size(513, 300), (256, 150));
        assert_eq!(panel_size(4096, 64), (512, 8));
    }

    #[test]
    fn resizing_takes_the_pixel_that_lies_there_and_shrinking_the_mean() {
        let image = GreyImage { width: 2, height: 1, pixels: vec![10, 20] };
        assert_eq!(resized(&image, (4, 2)).pixels, [10, 10, 20, 20, 10, 10, 20, 20]);
        assert_eq!(shrunk(&image, (1, 1)).pixels, [15]);
        let odd = ramp(7, 5);
        assert_eq!(shrunk(&odd, (3, 2)).pixels.len(), 6);
        assert_eq!(shrunk(&odd, (7, 5)), odd);
        assert_eq!(shrunk(&odd, (6, 5)).pixels.len(), 30);
    }

    #[test]
    fn votes_stand_in_their_cells_all_fields_in_one_scale() {
        let mut votes = [[0.0_f32; 4]; 12];
        (votes[0][0], votes[11][3]) = (2.0, -4.0);
        let fields: Vec<VoteField<'_>> = (1..)
            .zip(&votes)
            .map(|(label, votes)| VoteField { label, velocity: [8.0, -8.0], columns: 2, votes })
            .collect();
        let canvas = figure4(&fields);
        let count = |grey: u8| {
            let pixels = (0..canvas.height()).flat_map(|v| (0..canvas.width()).map(move |u| (u, v)));
            pixels.filter(|&(u, v)| canvas.colour_at(u, v) == Some([grey; 3])).count()
        };
        let cell = CELL_PX * CELL_PX;
        assert_eq!(count(GREY), (12 * 4 - 2) * cell);
        assert_eq!(count(192), cell, "half as strong as the strongest");
        assert_eq!(count(1), cell);
    }

    #[test]
    fn what_changed_between_levels_is_shown_with_its_sign() {
        let level = |value: u8| GreyImage { width: 2, height: 1, pixels: vec![value, 100] };
        let changed = changes(&[level(100), level(100), level(100)], &[level(110), level(95), level(100)]);
        assert_eq!(changed.map(|level| level.pixels[0]), [255, 65, GREY]);
        let mut figure = Figure2::default();
        let frame = ramp(64, 64);
        let first = figure.draw((None, &frame), Some([level(1), level(2), level(3)]));
        let second = figure.draw((Some(&frame), &frame), Some([level(1), level(2), level(9)]));
        assert_eq!((first.width(), first.height()), (second.width(), second.height()));
        assert_ne!(first, second);
    }
}
