//! A frame with what was found in it drawn in.

use pursuit_images::{Canvas, Colour, GreyImage};

use super::detector::{Answer, Target};

/// Arrows show this many frames of motion; one frame's would be too short to see.
const ARROW_FRAMES: f64 = 4.0;
/// Longer arms than this, times the width of the pen, hide the target.
const CROSS_ARM_PX: f64 = 5.0;
/// Sides above a multiple of this get wider lines: they are looked at in a smaller size.
const SIDE_FOR_A_PEN_PX: u32 = 480;
/// The same for letters.
const SIDE_FOR_A_DOT_PX: u32 = 240;
/// Where there are fewer dots in a row there is room for a number only.
const DOTS_FOR_WORDS: u32 = 160;
/// Nothing is drawn larger than this many times.
const LARGEST_SCALE: u32 = 8;
const TARGET: Colour = [255, 64, 48];
const AREA: Colour = [255, 208, 0];
const BACKGROUND: Colour = [64, 192, 255];
const AROUND_LETTERS: Colour = [0, 0, 0];

/// The frame with a cross on the target, a circle of its area, and an arrow along its motion in
/// [`ARROW_FRAMES`] frames, its confidence and speed beside it; the same arrow of the background starts in the
/// middle, its speed stands below. Where there is no target, a word says so.
pub fn annotated(frame: &GreyImage, answer: &Answer) -> Canvas {
    let shorter = frame.width.min(frame.height);
    let scale = |side: u32| (shorter / side).clamp(1, LARGEST_SCALE);
    let (pen, letters) = (scale(SIDE_FOR_A_PEN_PX), scale(SIDE_FOR_A_DOT_PX));
    let mut canvas = Canvas::over(frame).with_pen(pen);
    let middle = (f64::from(frame.width / 2), f64::from(frame.height / 2));
    let (vu, vv) = answer.background;
    canvas.arrow(middle, (ARROW_FRAMES * vu, ARROW_FRAMES * vv), BACKGROUND);
    if has_room_for_words(&canvas, letters) {
        let bottom = f64::from(frame.height);
        write(&mut canvas, (0.0, bottom), &[speed("background ", vu, vv)], letters, BACKGROUND);
    }
    match &answer.target {
        Ok(target) => draw_target(&mut canvas, target, f64::from(pen), letters),
        Err(_) => write(&mut canvas, (0.0, 0.0), &["no target".to_owned()], letters, TARGET),
    }
    canvas
}

fn draw_target(canvas: &mut Canvas, target: &Target, pen: f64, letters: u32) {
    let centre = (target.u, target.v);
    let radius = (target.area_px / std::f64::consts::PI).sqrt();
    canvas.circle(centre, radius, AREA);
    canvas.arrow(centre, (ARROW_FRAMES * target.vu, ARROW_FRAMES * target.vv), TARGET);
    canvas.cross(centre, CROSS_ARM_PX * pen, TARGET);
    let confidence = format!("{:.2}", target.confidence);
    let lines = if has_room_for_words(canvas, letters) {
        vec![format!("conf {confidence}"), speed("", target.vu, target.vv)]
    } else {
        vec![confidence]
    };
    let beside = radius + 4.0 * f64::from(letters);
    let length = f64::from(widest(&lines, letters));
    let left = if target.u + beside + length < f64::from(canvas.width()) {
        target.u + beside
    } else {
        target.u - beside - length
    };
    let rise = f64::from(line_height(letters)) * lines.len() as f64 / 2.0;
    write(canvas, (left, target.v - rise), &lines, letters, AREA);
}

fn has_room_for_words(canvas: &Canvas, scale: u32) -> bool {
    canvas.width() >= DOTS_FOR_WORDS * scale
}

fn speed(of: &str, vu: f64, vv: f64) -> String {
    format!("{of}{:.1} px/frame", vu.hypot(vv))
}

fn widest(lines: &[String], scale: u32) -> u32 {
    lines.iter().map(|line| Canvas::text_size(line, scale).0).max().unwrap_or_default()
}

fn line_height(scale: u32) -> u32 {
    Canvas::text_size("", scale).1 + 3 * scale
}

/// Lines of text with a dark rim, moved into the canvas where they would reach out of it.
fn write(canvas: &mut Canvas, corner: (f64, f64), lines: &[String], scale: u32, colour: Colour) {
    let inside = |at: f64, length: u32, side: u32| {
        let (rim, last) = (i64::from(scale), i64::from(side) - i64::from(length));
        // A cast from f64 keeps to the range of i64 and makes NaN 0.
        (at.round() as i64).min(last - rim).max(rim)
    };
    let height = line_height(scale);
    let left = inside(corner.0, widest(lines, scale), canvas.width());
    let top = inside(corner.1, height * lines.len() as u32, canvas.height());
    for (line, top) in lines.iter().zip((top..).step_by(height as usize)) {
        for (du, dv) in [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)] {
            let rim = (left + du * i64::from(scale), top + dv * i64::from(scale));
            canvas.text(rim, line, scale, AROUND_LETTERS);
        }
        canvas.text((left, top), line, scale, colour);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::detector::Times;

    const GREY: Colour = [90; 3];

    fn drawn(size: (u32, u32), target: Result<Target, String>) -> (Canvas, Vec<(u32, u32, Colour)>) {
        let pixels = vec![GREY[0]; (size.0 * size.1) as usize];
        let frame = GreyImage { width: size.0, height: size.1, pixels };
        let canvas = annotated(
            &frame,
            &Answer { target, pair: None, background: (5.0, 0.0), times: Times::default() },
        );
        let all = (0..size.1).flat_map(|v| (0..size.0).map(move |u| (u, v)));
        let coloured = all.filter_map(|(u, v)| canvas.colour_at(u, v).map(|colour| (u, v, colour)));
        let coloured = coloured.filter(|(_, _, colour)| *colour != GREY).collect();
        (canvas, coloured)
    }

    fn target(u: f64, v: f64) -> Target {
        Target {
            u,
            v,
            vu: 0.0,
            vv: -6.0,
            confidence: 0.75,
            area_px: std::f64::consts::PI * 400.0,
            uncertainty: None,
            track: None,
            coasting: false,
        }
    }

    #[test]
    fn position_extent_velocity_and_background_are_where_they_belong() {
        let (canvas, _) = drawn((320, 240), Ok(target(100.0, 60.0)));
        assert_eq!(canvas.colour_at(100, 65), Some(TARGET), "the cross");
        assert_eq!(canvas.colour_at(80, 60), Some(AREA), "the circle");
        assert_eq!(canvas.colour_at(100, 36), Some(TARGET), "the tip of the arrow, four frames on");
        assert_eq!(canvas.colour_at(180, 120), Some(BACKGROUND), "that of the background");
    }

    #[test]
    fn words_stay_inside_wherever_the_target_is() {
        for (u, v) in [(0.0, 0.0), (319.0, 239.0), (-40.0, 500.0), (310.0, 10.0)] {
            let (_, coloured) = drawn((320, 240), Ok(target(u, v)));
            let letters = coloured.iter().filter(|(_, _, colour)| *colour == AROUND_LETTERS).count();
            assert!(letters > 400, "{letters} pixels around the letters with the target at ({u}, {v})");
        }
    }

    #[test]
    fn a_small_frame_keeps_most_of_its_pixels() {
        for found in [Ok(target(30.0, 30.0)), Err("nothing moves".to_owned())] {
            let (_, coloured) = drawn((64, 64), found);
            assert!((100..64 * 64 / 3).contains(&coloured.len()), "{}", coloured.len());
        }
    }

    #[test]
    fn a_large_frame_gets_wide_lines() {
        let (_, small) = drawn((480, 480), Ok(target(100.0, 60.0)));
        let (_, large) = drawn((1920, 1920), Ok(target(400.0, 240.0)));
        assert!(large.len() > 4 * small.len());
    }
}
