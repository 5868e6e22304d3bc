//! The one entry of `pursuit`.
fn main() {}
