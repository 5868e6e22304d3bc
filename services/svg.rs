//! Line plots as SVG, readable on light and dark pages.

use std::fmt::Write as _;

/// Size of the whole picture, px.
const SIZE: (f64, f64) = (760.0, 520.0);
/// Left, top, right, bottom margins, px.
const MARGIN: [f64; 4] = [70.0, 48.0, 24.0, 56.0];
/// Wanted number of ticks per axis.
const TICKS: f64 = 7.0;
/// A logarithmic axis over more decades than this is marked at the powers of ten alone.
const MANY_DECADES: f64 = 3.0;

/// One curve or cloud of points.
pub struct Series {
    /// Name in the legend; empty for none.
    pub name: String,
    /// Colour, as CSS writes it.
    pub colour: &'static str,
    /// Points in data units; one that is not finite breaks the line.
    pub points: Vec<[f64; 2]>,
    /// How it is drawn.
    pub mark: Mark,
}

/// How a series is drawn.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A line.
    Line,
    /// A dashed line.
    Dashed,
    /// Dots.
    Dots,
}

/// A plot.
pub struct Plot {
    /// Title.
    pub title: String,
    /// Label of the horizontal axis.
    pub x_label: String,
    /// Label of the vertical axis.
    pub y_label: String,
    /// Whether one unit is as long on both axes.
    pub equal_axes: bool,
    /// Whether the vertical axis is logarithmic; values must be above 0.
    pub log_y: bool,
    /// What is drawn, in this order.
    pub series: Vec<Series>,
}

struct Axes {
    low: [f64; 2],
    high: [f64; 2],
    log_y: bool,
}

impl Plot {
    /// The picture.
    pub fn svg(&self) -> String {
        let axes = self.axes();
        let mut svg = head(SIZE, MARGIN[0], &self.title);
        self.draw_grid(&axes, &mut svg);
        for series in &self.series {
            draw_series(series, &axes, &mut svg);
        }
        self.draw_legend(&mut svg);
        svg.push_str("</svg>\n");
        svg
    }

    fn axes(&self) -> Axes {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let finite = |p: &&[f64; 2]| p.iter().all(|v| v.is_finite()) && (!self.log_y || p[1] > 0.0);
        for point in self.series.iter().flat_map(|s| &s.points).filter(finite) {
            let y = if self.log_y { point[1].log10() } else { point[1] };
            for (axis, value) in [point[0], y].into_iter().enumerate() {
                low[axis] = low[axis].min(value);
                high[axis] = high[axis].max(value);
            }
        }
        for axis in 0..2 {
            if low[axis] > high[axis] {
                (low[axis], high[axis]) = (0.0, 1.0);
            }
            let pad = 0.05 * (high[axis] - low[axis]).max(1e-9);
            low[axis] -= pad;
            high[axis] += pad;
        }
        if self.equal_axes {
            let inner = inner_size();
            let per_px = ((high[0] - low[0]) / inner[0]).max((high[1] - low[1]) / inner[1]);
            for axis in 0..2 {
                let middle = 0.5 * (low[axis] + high[axis]);
                low[axis] = middle - 0.5 * per_px * inner[axis];
                high[axis] = middle + 0.5 * per_px * inner[axis];
            }
        }
        Axes { low, high, log_y: self.log_y }
    }

    fn draw_grid(&self, axes: &Axes, svg: &mut String) {
        let [left, top, right, bottom] = MARGIN;
        let (width, height) = SIZE;
        for value in ticks(axes.low[0], axes.high[0], 1.0) {
            let [x, _] = axes.place_linear([value, axes.low[1]]);
            let _ = writeln!(
                svg,
                "<line class=\"grid\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{top}\" y2=\"{b:.1}\"/>\
                 <text class=\"ink\" x=\"{x:.1}\" y=\"{t:.1}\" text-anchor=\"middle\">{}</text>",
                short(value),
                b = height - bottom,
                t = height - bottom + 18.0
            );
        }
        let [low, high] = [axes.low[1], axes.high[1]];
        let values = if self.log_y { log_ticks(low, high) } else { ticks(low, high, f64::MIN_POSITIVE) };
        for value in values {
            let [_, y] = axes.place_linear([axes.low[0], value]);
            let label = if self.log_y { short(10f64.powf(value)) } else { short(value) };
            let _ = writeln!(
                svg,
                "<line class=\"grid\" x1=\"{left}\" x2=\"{r:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>\
                 <text class=\"ink\" x=\"{l:.1}\" y=\"{ty:.1}\" text-anchor=\"end\">{label}</text>",
                r = width - right,
                l = left - 8.0,
                ty = y + 4.0
            );
        }
        let _ = writeln!(
            svg,
            "<text class=\"ink\" x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"middle\">{}</text>\
             <text class=\"ink\" transform=\"translate(18 {m:.1}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
            escape(&self.x_label),
            escape(&self.y_label),
            x = (left + width - right) / 2.0,
            y = height - 14.0,
            m = (top + height - bottom) / 2.0
        );
    }

    fn draw_legend(&self, svg: &mut String) {
        let named = self.series.iter().filter(|series| !series.name.is_empty());
        for (row, series) in named.enumerate() {
            let (x, y) = (SIZE.0 - MARGIN[2] - 260.0, MARGIN[1] + 16.0 + 18.0 * row as f64);
            let _ = writeln!(
                svg,
                "<rect x=\"{x}\" y=\"{r}\" width=\"22\" height=\"4\" fill=\"{colour}\"/>\
                 <text class=\"ink\" x=\"{t}\" y=\"{y}\">{name}</text>",
                r = y - 6.0,
                t = x + 30.0,
                colour = series.colour,
                name = escape(&series.name)
            );
        }
    }
}

/// The beginning of a picture of this width and height, px: paper and title. Text wants the class `ink`, lines
/// the class `grid`; `</svg>` ends it.
pub fn head((width, height): (f64, f64), title_x: f64, title: &str) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" \
         height=\"{height}\" font-family=\"sans-serif\" font-size=\"13\">\n\
         <style>.ink{{fill:#1a1a1a}}.grid{{stroke:#d8d8d8}}.paper{{fill:#ffffff}}\
         @media(prefers-color-scheme:dark){{.ink{{fill:#e8e8e8}}.grid{{stroke:#444}}.paper{{fill:#16181c}}}}</style>\n\
         <rect class=\"paper\" width=\"{width}\" height=\"{height}\"/>\n\
         <text class=\"ink\" x=\"{title_x}\" y=\"26\" font-size=\"16\">{title}</text>\n",
        title = escape(title)
    )
}

impl Axes {
    fn place(&self, point: [f64; 2]) -> [f64; 2] {
        self.place_linear([point[0], if self.log_y { point[1].log10() } else { point[1] }])
    }

    fn place_linear(&self, point: [f64; 2]) -> [f64; 2] {
        let inner = inner_size();
        let share = [0, 1].map(|axis| (point[axis] - self.low[axis]) / (self.high[axis] - self.low[axis]));
        [MARGIN[0] + share[0] * inner[0], MARGIN[1] + (1.0 - share[1]) * inner[1]]
    }
}

fn draw_series(series: &Series, axes: &Axes, svg: &mut String) {
    let placed = series.points.iter().map(|point| axes.place(*point));
    if series.mark == Mark::Dots {
        for [x, y] in placed.filter(|p| p.iter().all(|v| v.is_finite())) {
            let _ = write!(svg, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"1.6\" fill=\"{}\"/>", series.colour);
        }
        svg.push('\n');
        return;
    }
    let mut path = String::new();
    let mut pen_down = false;
    for [x, y] in placed {
        if !x.is_finite() || !y.is_finite() {
            pen_down = false;
            continue;
        }
        let _ = write!(path, "{}{x:.1} {y:.1}", if pen_down { "L" } else { "M" });
        pen_down = true;
    }
    let dashes = if series.mark == Mark::Dashed { " stroke-dasharray=\"6 4\"" } else { "" };
    let _ = writeln!(
        svg,
        "<path d=\"{path}\" fill=\"none\" stroke=\"{}\" stroke-width=\"1.6\"{dashes}/>",
        series.colour
    );
}

fn inner_size() -> [f64; 2] {
    [SIZE.0 - MARGIN[0] - MARGIN[2], SIZE.1 - MARGIN[1] - MARGIN[3]]
}

/// Round values between `low` and `high`, 1, 2 or 5 times a power of ten apart.
fn ticks(low: f64, high: f64, least_step: f64) -> Vec<f64> {
    let rough = (high - low) / TICKS;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|k| k * power).into_iter().find(|s| *s >= rough).unwrap_or(rough);
    let step = if least_step >= 1.0 { step.max(1.0) } else { step };
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last).map(|k| k as f64 * step).collect()
}

/// Decimal logarithms of 1, 2 and 5 times the powers of ten between 10^`low` and 10^`high`; of the powers
/// alone where there are many.
fn log_ticks(low: f64, high: f64) -> Vec<f64> {
    let parts: &[f64] = if high - low > MANY_DECADES { &[1.0] } else { &[1.0, 2.0, 5.0] };
    let powers = low.floor() as i32..=high.ceil() as i32;
    let all = powers.flat_map(|power| parts.iter().map(move |part| f64::from(power) + part.log10()));
    all.filter(|value| (low..=high).contains(value)).collect()
}

fn short(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// The text with the signs replaced that mean something in SVG.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(points: Vec<[f64; 2]>) -> Plot {
        Plot {
            title: "a < b".to_owned(),
            x_label: "x".to_owned(),
            y_label: "y".to_owned(),
            equal_axes: false,
            log_y: false,
            series: vec![Series { name: "s".to_owned(), colour: "red", points, mark: Mark::Line }],
        }
    }

    #[test]
    fn values_that_are_not_finite_break_the_line_and_nothing_else() {
        let svg = plot(vec![[0.0, 0.0], [1.0, f64::NAN], [2.0, 4.0], [3.0, 5.0]]).svg();
        assert_eq!(svg.matches('M').count() - svg.matches("Media").count(), 2, "{svg}");
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }

    #[test]
    fn nothing_to_draw_still_gives_a_picture() {
        let svg = plot(Vec::new()).svg();
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n") && !svg.contains("NaN"));
        assert!(svg.contains("a &lt; b"));
    }

    #[test]
    fn a_logarithmic_axis_has_marks_within_a_decade() {
        let values = |low: f64, high: f64| -> Vec<f64> {
            log_ticks(low.log10(), high.log10()).into_iter().map(|v| 10f64.powf(v)).collect()
        };
        for (is, wanted) in values(0.3, 24.0).into_iter().zip([0.5, 1.0, 2.0, 5.0, 10.0, 20.0]) {
            assert!((is / wanted - 1.0).abs() < 1e-12, "{is}, {wanted}");
        }
        assert_eq!(values(0.3, 24.0).len(), 6);
        assert_eq!(values(0.002, 30.0).len(), 4);
    }

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks(0.0, 1.0, f64::MIN_POSITIVE), [0.0, 0.2, 0.4, 0.6000000000000001, 0.8, 1.0]);
        assert!(ticks(-3.2, 7.9, f64::MIN_POSITIVE).iter().all(|t| (-3.2..=7.9).contains(t)));
    }
}
