//! Lines over a frame: crosses, boxes, circles, arrows. Letters. Frames beside each other.

use std::path::Path;

use crate::letters::{self, GLYPH_COLUMNS, GLYPH_ROWS};
use crate::write::png_rgb;
use crate::{GreyImage, ImagesError, write_png_rgb};

/// Points farther out are no image coordinates (and clipping would lose its precision).
const FARTHEST: f64 = 1e9;

/// Red, green, blue.
pub type Colour = [u8; 3];

/// An RGB image to draw on. Points are (u, v) in pixels, u right, v down, (0, 0) the centre of the top-left
/// pixel. What lies outside is cut off; what is not finite or absurdly far out is not drawn.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Canvas {
    width: u32,
    height: u32,
    pixels: Vec<u8>,
    pen_px: u32,
}

impl Canvas {
    /// All of one colour.
    pub fn filled(width: u32, height: u32, colour: Colour) -> Canvas {
        let pixels = colour.repeat(width as usize * height as usize);
        Canvas { width, height, pixels, pen_px: 1 }
    }

    /// The frame in shades of grey.
    ///
    /// # Panics
    /// When `frame` has not `width * height` pixels.
    pub fn over(frame: &GreyImage) -> Canvas {
        let (width, height) = (frame.width, frame.height);
        assert_eq!(frame.pixels.len() as u64, u64::from(width) * u64::from(height), "not a whole frame");
        let pixels = frame.pixels.iter().flat_map(|&grey| [grey; 3]).collect();
        Canvas { width, height, pixels, pen_px: 1 }
    }

    /// Lines become so many pixels wide; 1 at first.
    #[must_use]
    pub fn with_pen(self, pen_px: u32) -> Canvas {
        Canvas { pen_px: pen_px.max(1), ..self }
    }

    /// Width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The colour of a pixel, `None` outside.
    pub fn colour_at(&self, column: u32, row: u32) -> Option<Colour> {
        let index = 3 * self.index(i64::from(column), i64::from(row))?;
        Some([self.pixels[index], self.pixels[index + 1], self.pixels[index + 2]])
    }

    /// A straight line, both ends included (Bresenham).
    pub fn line(&mut self, from: (f64, f64), to: (f64, f64), colour: Colour) {
        let Some((from, to)) = self.clipped(from, to) else { return };
        let (mut u, mut v) = (from.0.round() as i64, from.1.round() as i64);
        let (end_u, end_v) = (to.0.round() as i64, to.1.round() as i64);
        let (du, dv) = ((end_u - u).abs(), -(end_v - v).abs());
        let (step_u, step_v) = ((end_u - u).signum(), (end_v - v).signum());
        let mut error = du + dv;
        loop {
            self.set(u, v, colour);
            if (u, v) == (end_u, end_v) {
                return;
            }
            let doubled = 2 * error;
            if doubled >= dv {
                error += dv;
                u += step_u;
            }
            if doubled <= du {
                error += du;
                v += step_v;
            }
        }
    }

    /// An upright cross whose arms are `arm` pixels long.
    pub fn cross(&mut self, centre: (f64, f64), arm: f64, colour: Colour) {
        let (u, v) = centre;
        self.line((u - arm, v), (u + arm, v), colour);
        self.line((u, v - arm), (u, v + arm), colour);
    }

    /// The outline of a box; `corner` is its top-left pixel, `size` (width, height) in pixels, so that the
    /// bottom-right pixel is `corner + size - 1`.
    pub fn rectangle(&mut self, corner: (f64, f64), size: (f64, f64), colour: Colour) {
        let (left, top) = corner;
        let (right, bottom) = (left + size.0 - 1.0, top + size.1 - 1.0);
        self.line((left, top), (right, top), colour);
        self.line((right, top), (right, bottom), colour);
        self.line((right, bottom), (left, bottom), colour);
        self.line((left, bottom), (left, top), colour);
    }

    /// The outline of a circle (midpoint algorithm); one that is larger than the image is not drawn.
    pub fn circle(&mut self, centre: (f64, f64), radius: f64, colour: Colour) {
        let largest = f64::from(self.width) + f64::from(self.height);
        if !(radius.abs() <= largest && centre.0.abs() <= FARTHEST && centre.1.abs() <= FARTHEST) {
            return;
        }
        let (centre_u, centre_v) = (centre.0.round() as i64, centre.1.round() as i64);
        let (mut a, mut b) = (radius.abs().round() as i64, 0);
        let mut error = 1 - a;
        while a >= b {
            for (du, dv) in [(a, b), (b, a)] {
                for (sign_u, sign_v) in [(1, 1), (1, -1), (-1, 1), (-1, -1)] {
                    self.set(centre_u + sign_u * du, centre_v + sign_v * dv, colour);
                }
            }
            b += 1;
            if error < 0 {
                error += 2 * b + 1;
            } else {
                a -= 1;
                error += 2 * (b - a) + 1;
            }
        }
    }

    /// An arrow along `vector` from `tail`, its head a quarter of its length, at least 3 and at most 10 pixels.
    /// Shorter than a pixel it is not drawn.
    pub fn arrow(&mut self, tail: (f64, f64), vector: (f64, f64), colour: Colour) {
        let length = vector.0.hypot(vector.1);
        if !(length.is_finite() && length >= 1.0) {
            return;
        }
        let tip = (tail.0 + vector.0, tail.1 + vector.1);
        self.line(tail, tip, colour);
        let head = (length / 4.0).clamp(3.0, 10.0) / length;
        let back = (-vector.0 * head, -vector.1 * head);
        for side in [-0.5, 0.5] {
            let barb = (tip.0 + back.0 - side * back.1, tip.1 + back.1 + side * back.0);
            self.line(tip, barb, colour);
        }
    }

    /// Fills a box; `corner` is its top-left pixel, `size` (width, height) in pixels.
    pub fn fill(&mut self, corner: (i64, i64), size: (u32, u32), colour: Colour) {
        let visible = |from: i64, length: u32, side: u32| {
            let side = i64::from(side);
            from.clamp(0, side)..from.saturating_add(i64::from(length)).clamp(0, side)
        };
        for v in visible(corner.1, size.1, self.height) {
            for u in visible(corner.0, size.0, self.width) {
                self.put(u, v, colour);
            }
        }
    }

    /// Puts a frame there, its top-left pixel at `corner`.
    ///
    /// # Panics
    /// When `frame` has not `width * height` pixels.
    pub fn place(&mut self, corner: (i64, i64), frame: &GreyImage) {
        assert_eq!(
            frame.pixels.len() as u64,
            u64::from(frame.width) * u64::from(frame.height),
            "not a whole frame"
        );
        for (v, row) in (corner.1..).zip(frame.pixels.chunks_exact(frame.width as usize)) {
            for (u, &grey) in (corner.0..).zip(row) {
                self.put(u, v, [grey; 3]);
            }
        }
    }

    /// Writes a line of capital letters, digits and `.,-+/()=:%_`, `scale` pixels for each dot of the 5x7 that
    /// a letter has; `corner` is the top-left pixel of the first. What has no letter leaves a gap.
    pub fn text(&mut self, corner: (i64, i64), text: &str, scale: u32, colour: Colour) {
        let step = i64::from(scale);
        for (at, letter) in (0..).zip(text.chars()) {
            let left = corner.0 + at * step * i64::from(GLYPH_COLUMNS + 1);
            for (x, y) in letters::dots(letter) {
                let dot = (left + step * i64::from(x), corner.1 + step * i64::from(y));
                self.fill(dot, (scale, scale), colour);
            }
        }
    }

    /// Width and height in pixels of what [`Canvas::text`] writes.
    pub fn text_size(text: &str, scale: u32) -> (u32, u32) {
        let letters = text.chars().count() as u32;
        ((letters * (GLYPH_COLUMNS + 1)).saturating_sub(1) * scale, GLYPH_ROWS * scale)
    }

    /// Writes the canvas as a PNG file.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_png(&self, path: &Path) -> Result<(), ImagesError> {
        write_png_rgb(path, self.width, self.height, &self.pixels)
    }

    /// The canvas as the bytes of a PNG file.
    pub fn png(&self) -> Vec<u8> {
        png_rgb(self.width, self.height, &self.pixels)
    }

    fn index(&self, u: i64, v: i64) -> Option<usize> {
        let (width, height) = (i64::from(self.width), i64::from(self.height));
        ((0..width).contains(&u) && (0..height).contains(&v)).then_some((v * width + u) as usize)
    }

    /// A dot of the pen.
    fn set(&mut self, u: i64, v: i64, colour: Colour) {
        if self.pen_px == 1 {
            return self.put(u, v, colour);
        }
        let back = i64::from((self.pen_px - 1) / 2);
        self.fill((u - back, v - back), (self.pen_px, self.pen_px), colour);
    }

    fn put(&mut self, u: i64, v: i64, colour: Colour) {
        if let Some(index) = self.index(u, v) {
            self.pixels[3 * index..3 * index + 3].copy_from_slice(&colour);
        }
    }

    /// The part of a line within the image and half a pixel around it (Liang and Barsky 1984), so that the
    /// loop over its pixels is bounded; `None` when nothing of it is.
    fn clipped(&self, from: (f64, f64), to: (f64, f64)) -> Option<((f64, f64), (f64, f64))> {
        let (du, dv) = (to.0 - from.0, to.1 - from.1);
        if ![from.0, from.1, to.0, to.1].iter().all(|value| value.abs() <= FARTHEST) {
            return None;
        }
        let (right, bottom) = (f64::from(self.width) - 0.5, f64::from(self.height) - 0.5);
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        let sides = [(-du, from.0 + 0.5), (du, right - from.0), (-dv, from.1 + 0.5), (dv, bottom - from.1)];
        for (towards, distance) in sides {
            if towards == 0.0 {
                if distance < 0.0 {
                    return None;
                }
            } else if towards < 0.0 {
                enter = enter.max(distance / towards);
            } else {
                leave = leave.min(distance / towards);
            }
        }
        let at = |t: f64| ((from.0 + t * du).clamp(-0.5, right), (from.1 + t * dv).clamp(-0.5, bottom));
        (enter <= leave).then(|| (at(enter), at(leave)))
    }
}
