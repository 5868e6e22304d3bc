//! Connected components on a small grid, without recursion or allocation.

/// Working memory for floods over a grid.
#[derive(Clone, Debug)]
pub(crate) struct Flood {
    columns: usize,
    rows: usize,
    seen: Vec<bool>,
    cells: Vec<usize>,
}

impl Flood {
    /// For grids of up to `cells` cells.
    pub(crate) fn new(cells: usize) -> Flood {
        Flood { columns: 0, rows: 0, seen: vec![false; cells], cells: Vec::with_capacity(cells) }
    }

    /// Forgets which cells were seen, for a grid of `columns` x `rows`.
    pub(crate) fn start(&mut self, columns: usize, rows: usize) {
        (self.columns, self.rows) = (columns, rows);
        self.seen[..columns * rows].fill(false);
    }

    /// The cells of the 8-connected component around `seed` where `inside` holds, each once and in the
    /// order found; none where `inside` does not hold at `seed` or the component was found before.
    pub(crate) fn component(&mut self, seed: usize, inside: impl Fn(usize) -> bool) -> &[usize] {
        self.cells.clear();
        if self.seen[seed] || !inside(seed) {
            return &self.cells;
        }
        self.seen[seed] = true;
        self.cells.push(seed);
        let mut next = 0;
        while next < self.cells.len() {
            let (x, y) = (self.cells[next] % self.columns, self.cells[next] / self.columns);
            next += 1;
            for ny in y.saturating_sub(1)..(y + 2).min(self.rows) {
                for nx in x.saturating_sub(1)..(x + 2).min(self.columns) {
                    let cell = ny * self.columns + nx;
                    if !self.seen[cell] && inside(cell) {
                        self.seen[cell] = true;
                        self.cells.push(cell);
                    }
                }
            }
        }
        &self.cells
    }
}
