//! Evidence laid out over the frame, and what it says of a box and of everywhere else.

/// One channel's evidence at one window scale.
#[derive(Clone, Debug)]
pub(crate) struct Map {
    /// Cells per row.
    pub(crate) columns: usize,
    /// Rows of cells.
    pub(crate) rows: usize,
    /// Side of a cell, base px (pixels of level 1).
    pub(crate) cell: usize,
    /// Evidence of each cell.
    pub(crate) values: Vec<f32>,
    /// What evidence must exceed.
    pub(crate) threshold: f32,
    /// Whether this is the residual channel.
    pub(crate) untuned: bool,
}

/// What a map holds inside of a box and elsewhere.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Survey {
    /// Largest evidence over the threshold inside.
    pub(crate) inside: f32,
    /// The same elsewhere.
    pub(crate) outside: f32,
    /// Cells elsewhere, and those of them whose evidence is above half of the threshold.
    pub(crate) cells: usize,
    pub(crate) loud: usize,
}

/// Columns and rows (first, end), base px (pixels of level 1).
pub(crate) type Area = [(i32, i32); 2];

impl Map {
    /// The columns and rows (first, end) of the cells whose window reaches into the box.
    fn covered(&self, area: &Area) -> [(usize, usize); 2] {
        let side = self.cell as i32;
        // A cell counts where its middle is in the box or at most a cell beside it.
        let index = |edge: i32, count: usize| {
            (edge - side / 2 + side - 1).div_euclid(side).clamp(0, count as i32) as usize
        };
        let axis = |(first, end): (i32, i32), count| (index(first - side, count), index(end + side, count));
        [axis(area[0], self.columns), axis(area[1], self.rows)]
    }

    /// Largest evidence over the threshold, and its cell, outside of the boxes.
    pub(crate) fn peak(&self, taken: &[Area]) -> (f32, usize) {
        let mut best = (0.0, 0);
        for (y, row) in self.values.chunks_exact(self.columns).enumerate() {
            for (x, &value) in row.iter().enumerate() {
                if value > best.0 && !taken.iter().any(|area| self.covers(area, x, y)) {
                    best = (value, y * self.columns + x);
                }
            }
        }
        (best.0 / self.threshold, best.1)
    }

    fn covers(&self, area: &Area, x: usize, y: usize) -> bool {
        let [columns, rows] = self.covered(area);
        (columns.0..columns.1).contains(&x) && (rows.0..rows.1).contains(&y)
    }

    /// What there is inside of the box and elsewhere.
    pub(crate) fn survey(&self, area: &Area) -> Survey {
        let [columns, rows] = self.covered(area);
        let mut survey = Survey::default();
        let half = 0.5 * self.threshold;
        let elsewhere = |cells: &[f32], survey: &mut Survey| {
            for &value in cells {
                survey.outside = if value > survey.outside { value } else { survey.outside };
                survey.loud += usize::from(value > half);
            }
            survey.cells += cells.len();
        };
        for (y, row) in self.values.chunks_exact(self.columns).enumerate() {
            if (rows.0..rows.1).contains(&y) {
                elsewhere(&row[..columns.0], &mut survey);
                elsewhere(&row[columns.1..], &mut survey);
                for &value in &row[columns.0..columns.1] {
                    survey.inside = survey.inside.max(value);
                }
            } else {
                elsewhere(row, &mut survey);
            }
        }
        survey.inside /= self.threshold;
        survey.outside /= self.threshold;
        survey
    }
}
