//! Plots of a comparison as SVG, written by hand: one group of marks for each kind of scene, one
//! mark for each planner, told apart by shape as well as by color. The colors follow the reader's
//! light or dark scheme, on a ground of their own.

use std::fmt::Write;

use motion::trial::Kind;

use super::{Comparison, PLANNERS, Summary};

/// A plot: the end of its file's name, what it shows, and the picture.
pub struct Plot {
    /// Name of the file without its ending.
    pub name: &'static str,
    /// What it shows, in a line.
    pub title: String,
    /// The SVG.
    pub svg: String,
}

/// Width and height of a plot, and the edges of its frame.
const SIZE: [f64; 2] = [760.0, 320.0];
const LEFT: f64 = 64.0;
const RIGHT: f64 = 744.0;
const TOP: f64 = 58.0;
const BOTTOM: f64 = 286.0;

/// Colors of the planners, of the ground, of text and of lines: light scheme, dark scheme.
const STYLE: &str = "\
text{font:13px sans-serif;fill:#1f2328}.bg{fill:#fff}.grid{stroke:#d0d7de}\
.p0{color:#57606a}.p1{color:#a04b00}.p2{color:#0072b2}.p3{color:#9b3f8f}.p4{color:#00705a}\
.m{fill:currentColor;stroke:currentColor}\
@media(prefers-color-scheme:dark){text{fill:#e6edf3}.bg{fill:#0d1117}.grid{stroke:#30363d}\
.p0{color:#b1bac4}.p1{color:#f0a35e}.p2{color:#56b4e9}.p3{color:#e79bd8}.p4{color:#3fc9a5}}";

/// How values become heights.
#[derive(Clone, Copy)]
enum Axis {
    /// From the first value to the second.
    Linear(f64, f64),
    /// Decades from the first value to the second.
    Log(f64, f64),
}

impl Axis {
    fn height(self, value: f64) -> f64 {
        let share = match self {
            Axis::Linear(lo, hi) => (value - lo) / (hi - lo),
            Axis::Log(lo, hi) => (value.max(1e-12) / lo).ln() / (hi / lo).ln(),
        };
        BOTTOM - share.clamp(0.0, 1.0) * (BOTTOM - TOP)
    }

    fn ticks(self) -> Vec<f64> {
        match self {
            Axis::Linear(lo, hi) => (0..=5).map(|i| lo + (hi - lo) * f64::from(i) / 5.0).collect(),
            Axis::Log(lo, hi) => {
                let n = (hi / lo).log10().round() as i32;
                (0..=n).map(|i| lo * 10_f64.powi(i)).collect()
            }
        }
    }
}

/// A mark, and how far its spread goes.
struct Mark {
    at: f64,
    to: f64,
}

/// All plots of a comparison.
pub fn plots(comparison: &Comparison) -> Vec<Plot> {
    let plot = |name, title: &str, axis, bars, mark: &dyn Fn(&Summary) -> Option<Mark>| {
        let svg = draw(comparison, title, axis, bars, mark);
        Plot { name, title: title.to_owned(), svg }
    };
    let spread = |spread: super::Spread| Some(Mark { at: spread.median()?, to: spread.p95()? });
    vec![
        plot("success", "Steps found (%)", Axis::Linear(0.0, 100.0), true, &|s| {
            let at = 100.0 * s.share_found();
            Some(Mark { at, to: at })
        }),
        plot(
            "time",
            "Whole request (ms): median, and line to the 95th percentile",
            Axis::Log(0.1, 1e3),
            false,
            &|s| spread(s.whole_ms()),
        ),
        plot(
            "length",
            "Length over the best found: median, and line to the 95th percentile",
            Axis::Linear(1.0, 3.0),
            false,
            &|s| spread(s.over_best()),
        ),
        plot(
            "clearance",
            "Nearest distance in the transit (mm): median, and line to the least",
            Axis::Linear(0.0, 150.0),
            false,
            &|s| {
                let spread = s.clearance_mm();
                Some(Mark { at: spread.median()?, to: spread.at(0.0)? })
            },
        ),
    ]
}

fn draw(
    comparison: &Comparison,
    title: &str,
    axis: Axis,
    bars: bool,
    mark: &dyn Fn(&Summary) -> Option<Mark>,
) -> String {
    let mut body = String::new();
    let text = |x: f64, y: f64, anchor: &str, text: &str| {
        format!("<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>\n")
    };
    body += &text(LEFT, 20.0, "start", title);
    for (i, (name, _)) in PLANNERS.iter().enumerate() {
        let x = LEFT + 8.0 + 130.0 * i as f64;
        body += &shape(i, x, 40.0);
        body += &text(x + 12.0, 44.5, "start", name);
    }
    for tick in axis.ticks() {
        let y = axis.height(tick);
        let _ = writeln!(
            body,
            "<line class=\"grid\" x1=\"{LEFT}\" y1=\"{y:.1}\" x2=\"{RIGHT}\" y2=\"{y:.1}\"/>"
        );
        body += &text(LEFT - 8.0, y + 4.5, "end", &number(tick));
    }
    let group = (RIGHT - LEFT) / Kind::ALL.len() as f64;
    for (g, kind) in Kind::ALL.into_iter().enumerate() {
        let left = LEFT + group * g as f64;
        body += &text(left + 0.5 * group, BOTTOM + 20.0, "middle", kind.name());
        for i in 0..PLANNERS.len() {
            let x = left + group * (i as f64 + 1.0) / (PLANNERS.len() + 1) as f64;
            let Some(mark) = mark(&comparison.summary(i, Some(kind))) else { continue };
            let (at, to) = (axis.height(mark.at), axis.height(mark.to));
            // A bar stands on the axis; a spread goes from its median to its end.
            let (from, to, width) = if bars { (at, BOTTOM, 8.0) } else { (at, to, 2.0) };
            let _ = writeln!(
                body,
                "<line class=\"m p{i}\" stroke-width=\"{width}\" x1=\"{x:.1}\" y1=\"{from:.1}\" \
                 x2=\"{x:.1}\" y2=\"{to:.1}\"/>"
            );
            body += &shape(i, x, at);
        }
    }
    let [width, height] = SIZE;
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" \
         width=\"{width}\" height=\"{height}\" role=\"img\">\n<title>{title}</title>\n\
         <style>{STYLE}</style>\n\
         <rect class=\"bg\" width=\"{width}\" height=\"{height}\"/>\n{body}</svg>\n"
    )
}

/// The mark of a planner: each has its own shape.
fn shape(planner: usize, x: f64, y: f64) -> String {
    let path = match planner {
        0 => "M-4-4L4 4M-4 4L4-4",
        1 => "M-5 4L0-5L5 4Z",
        2 => "M-4-4H4V4H-4Z",
        3 => "M0-5.5L5.5 0L0 5.5L-5.5 0Z",
        _ => "M-5 0a5 5 0 1 0 10 0a5 5 0 1 0-10 0Z",
    };
    let width = if planner == 0 { 2.5 } else { 1.0 };
    format!(
        "<path class=\"m p{planner}\" stroke-width=\"{width}\" transform=\"translate({x:.1} {y:.1})\" \
         d=\"{path}\"/>\n"
    )
}

fn number(value: f64) -> String {
    let text = format!("{value:.1}");
    text.strip_suffix(".0").map_or(text.clone(), str::to_owned)
}
