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
        let columns = self.columns;
        while next < self.cells.len() {
            let cell = self.cells[next];
            next += 1;
            let (x, y) = (cell as u32 % columns as u32, cell as u32 / columns as u32);
            let (x, y) = (x as usize, y as usize);
            let is_inner = x > 0 && x + 1 < columns && y > 0 && y + 1 < self.rows;
            if is_inner {
                let (above, below) = (cell - columns, cell + columns);
                let around = [above - 1, above, above + 1, cell - 1, cell + 1, below - 1, below, below + 1];
                for other in around {
                    self.visit(other, &inside);
                }
            } else {
                for ny in y.saturating_sub(1)..(y + 2).min(self.rows) {
                    for nx in x.saturating_sub(1)..(x + 2).min(columns) {
                        self.visit(ny * columns + nx, &inside);
                    }
                }
            }
        }
        &self.cells
    }

    #[inline(always)]
    fn visit(&mut self, cell: usize, inside: &impl Fn(usize) -> bool) {
        if !self.seen[cell] && inside(cell) {
            self.seen[cell] = true;
            self.cells.push(cell);
        }
    }
}
