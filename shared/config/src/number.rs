//! Numbers and the ranges that they are checked against.

use std::fmt::Display;
use std::ops::{Bound, RangeBounds};

/// The integer types that a configuration can be read as.
pub trait Integer: Copy + PartialOrd + Display + TryFrom<i64> {
    /// Zero, the harmless value of an unbounded range.
    const ZERO: Self;
}

macro_rules! integers {
    ($($integer:ty),*) => { $(impl Integer for $integer { const ZERO: Self = 0; })* };
}
integers!(u8, u16, u32, u64, usize, i8, i16, i32, i64);

/// `between 0.1 and 1000`, `at least 3`, `below 1`: what a number must be.
pub(crate) fn demanded<T: Copy>(range: &impl RangeBounds<T>, show: impl Fn(T) -> String) -> String {
    match (range.start_bound(), range.end_bound()) {
        (Bound::Included(&a), Bound::Included(&b)) => format!("between {} and {}", show(a), show(b)),
        (Bound::Unbounded, Bound::Unbounded) => "a number".to_owned(),
        (start, end) => {
            let start = match start {
                Bound::Included(&a) => format!("at least {}", show(a)),
                Bound::Excluded(&a) => format!("above {}", show(a)),
                Bound::Unbounded => String::new(),
            };
            let end = match end {
                Bound::Included(&b) => format!("at most {}", show(b)),
                Bound::Excluded(&b) => format!("below {}", show(b)),
                Bound::Unbounded => String::new(),
            };
            let both = if start.is_empty() || end.is_empty() { "" } else { " and " };
            format!("{start}{both}{end}")
        }
    }
}

/// A value to go on with after a fault: the start of the range, else its end, else zero.
pub(crate) fn harmless<T: Copy>(range: &impl RangeBounds<T>, zero: T) -> T {
    match (range.start_bound(), range.end_bound()) {
        (Bound::Included(&a) | Bound::Excluded(&a), _) => a,
        (Bound::Unbounded, Bound::Included(&b) | Bound::Excluded(&b)) => b,
        (Bound::Unbounded, Bound::Unbounded) => zero,
    }
}

/// A float as a person writes it: `0.1`, `5000`, `1e300`.
pub(crate) fn shown(number: f64) -> String {
    let size = number.abs();
    if size == 0.0 || (1e-5..1e15).contains(&size) { format!("{number}") } else { format!("{number:e}") }
}
