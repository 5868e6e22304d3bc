//! Titled pictures beside each other on one sheet.

use pursuit_images::{Canvas, Colour, GreyImage};

/// Pictures in a row.
pub const COLUMNS: usize = 4;
/// Between pictures and around them.
const GAP_PX: u32 = 6;
/// A dot of a letter is a pixel more for each of this width of a picture.
const WIDTH_FOR_A_DOT_PX: u32 = 160;
const PAPER: Colour = [24, 24, 24];
const INK: Colour = [224, 224, 224];

/// A picture and what stands above it.
pub struct Panel {
    /// A word or two.
    pub title: String,
    /// The picture.
    pub picture: GreyImage,
}

/// The panels in rows of [`COLUMNS`], all with the room that the largest needs, and a line below.
pub fn sheet(panels: &[Panel], caption: &str) -> Canvas {
    let size_of = |side: fn(&GreyImage) -> u32| panels.iter().map(|p| side(&p.picture)).max().unwrap_or(1);
    let (width, height) = (size_of(|p| p.width), size_of(|p| p.height));
    let scale = (width / WIDTH_FOR_A_DOT_PX).max(1);
    let titles =
        panels.iter().map(|panel| Canvas::text_size(&panel.title, scale).0).max().unwrap_or_default();
    let (caption_width, letters) = Canvas::text_size(caption, scale);
    let line = letters + GAP_PX;
    let (column, row) = (width.max(titles) + GAP_PX, line + height + GAP_PX);
    let rows = panels.len().div_ceil(COLUMNS) as u32;
    let sheet_width = (COLUMNS as u32 * column).max(caption_width + GAP_PX) + GAP_PX;
    let mut canvas = Canvas::filled(sheet_width, rows * row + line + GAP_PX, PAPER);
    for (index, panel) in panels.iter().enumerate() {
        let (x, y) = ((index % COLUMNS) as u32, (index / COLUMNS) as u32);
        let (left, top) = (i64::from(GAP_PX + x * column), i64::from(GAP_PX + y * row));
        canvas.text((left, top), &panel.title, scale, INK);
        canvas.place((left, top + i64::from(line)), &panel.picture);
    }
    canvas.text((i64::from(GAP_PX), i64::from(GAP_PX + rows * row)), caption, scale, INK);
    canvas
}
