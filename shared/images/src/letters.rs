//! Letters of 5x7 dots.

/// Columns of a letter, dots.
pub(crate) const GLYPH_COLUMNS: u32 = 5;
/// Rows of a letter, dots.
pub(crate) const GLYPH_ROWS: u32 = 7;

/// One letter a line: itself, then its rows from the top.
const GLYPHS: &str = include_str!("letters.txt");

/// The dots (column, row) of a letter in its capital form, none where there is no such letter.
pub(crate) fn dots(letter: char) -> impl Iterator<Item = (u32, u32)> {
    let capital = letter.to_ascii_uppercase();
    let rows =
        GLYPHS.lines().find_map(|line| line.strip_prefix(capital)?.strip_prefix(' ')).unwrap_or_default();
    (0..)
        .zip(rows.split(' '))
        .flat_map(|(y, row)| (0..).zip(row.bytes()).filter(|&(_, dot)| dot == b'#').map(move |(x, _)| (x, y)))
}
