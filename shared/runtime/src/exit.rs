//! Exit codes: what the supervisor and scripts can tell from them.

/// All well.
pub const OK: u8 = 0;
/// Something failed; starting again may help.
pub const FAILED: u8 = 1;
/// The input of a verb (a folder of images, say) cannot be worked on.
pub const BAD_INPUT: u8 = 2;
/// Wrong config or command line, or a peer of another version: starting again does not help.
pub const DO_NOT_RESTART: u8 = 64;
/// Another process holds the instance.
pub const HELD: u8 = 75;
