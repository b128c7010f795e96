//! Colours and type of every report, for light and dark.

/// A colour by meaning of its own; the same ink is readable on light and dark paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Ink {
    /// Blue.
    Blue,
    /// Vermilion, a red that is told from green without seeing either.
    Vermilion,
    /// Bluish green.
    Green,
    /// Orange.
    Orange,
    /// Reddish purple.
    Purple,
    /// Sky blue.
    Sky,
    /// Grey: what is there without standing out.
    Grey,
    /// The colour of text.
    Text,
}

impl Ink {
    /// The name of this ink in the style sheet.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Blue => "blue",
            Self::Vermilion => "verm",
            Self::Green => "green",
            Self::Orange => "orange",
            Self::Purple => "purple",
            Self::Sky => "sky",
            Self::Grey => "grey",
            Self::Text => "text",
        }
    }
}

/// Inks on light paper (Okabe and Ito, "Color Universal Design").
const LIGHT: &str = "--paper:#fdfcfa;--panel:#fff;--text:#1f2328;--soft:#5b6470;--rule:#dcd8d0;--warn:#fbeccb;\
--blue:#0072b2;--verm:#d55e00;--green:#008a66;--orange:#c98a00;--purple:#b3568f;--sky:#3d9bd0;--grey:#8a919b;";
/// The same, lighter, on dark paper.
const DARK: &str = "--paper:#14171b;--panel:#1b1f25;--text:#e6e8eb;--soft:#a5adb8;--rule:#363d47;--warn:#4a3a12;\
--blue:#5cb8f2;--verm:#ff8c42;--green:#33c79c;--orange:#f0b940;--purple:#e293c4;--sky:#8fd0f5;--grey:#7d8691;";

/// Rules of the figures; maps are light on any paper, so their inks stay those of light paper.
const FIGURES: &str = "text{font-family:system-ui,-apple-system,\"Segoe UI\",sans-serif;font-size:14px;fill:var(--text)}\
.soft{fill:var(--soft)}.small{font-size:12.5px}.strong{font-weight:600}.e{text-anchor:end}.m{text-anchor:middle}\
.grid{stroke:var(--rule);stroke-width:1;fill:none}.axis{stroke:var(--soft);stroke-width:1;fill:none}\
.line,.stem{fill:none;stroke-width:1.6;stroke-linejoin:round;stroke-linecap:round}.dash{stroke-dasharray:6 4}\
.dots{fill:none;stroke-width:3.6;stroke-linecap:round;opacity:.45}.panel{fill:var(--panel);stroke:var(--rule)}\
.card{fill:var(--paper)}.mark{stroke:var(--paper);stroke-width:1.5}.median{stroke-width:2.6}.halo{stroke:#fff;stroke-opacity:.85;fill:none;stroke-linejoin:round;stroke-linecap:round}";

const INKS: [Ink; 8] =
    [Ink::Blue, Ink::Vermilion, Ink::Green, Ink::Orange, Ink::Purple, Ink::Sky, Ink::Grey, Ink::Text];

/// The style sheet of figures, for an SVG that stands alone.
pub(crate) fn figure_sheet() -> String {
    let mut sheet = format!(
        ":root{{{LIGHT}color-scheme:light dark}}@media(prefers-color-scheme:dark){{:root{{{DARK}}}}}{FIGURES}"
    );
    sheet.push_str(&inks());
    sheet
}

fn inks() -> String {
    let rules = INKS.iter().map(|ink| {
        let name = ink.name();
        format!(".s-{name}{{stroke:var(--{name})}}.f-{name}{{fill:var(--{name})}}")
    });
    // A group's own variables win over those of the page.
    rules.chain([format!(".map{{{LIGHT}}}")]).collect()
}

/// The style sheet of a page.
pub(crate) fn page_sheet() -> String {
    let mut sheet = format!(
        ":root{{{LIGHT}color-scheme:light dark}}@media(prefers-color-scheme:dark){{:root{{{DARK}}}}}"
    );
    sheet.push_str(
        "*{box-sizing:border-box}\
body{margin:0;background:var(--paper);color:var(--text);font:16px/1.55 system-ui,-apple-system,\"Segoe UI\",sans-serif}\
main{max-width:1040px;margin:0 auto;padding:32px 24px 64px}\
h1{font-size:30px;line-height:1.2;margin:0 0 8px}h2{font-size:22px;margin:44px 0 8px;padding-top:14px;border-top:1px solid var(--rule)}\
h3{font-size:17px;margin:24px 0 4px}p{margin:8px 0 12px;max-width:78ch}.sub{color:var(--soft);margin-bottom:18px}\
.warn{background:var(--warn);padding:10px 14px;border-radius:6px}\
.scroll{overflow-x:auto}table{border-collapse:collapse;margin:10px 0 18px;font-size:15px;font-variant-numeric:tabular-nums}\
th,td{padding:5px 14px 5px 0;text-align:left;vertical-align:top}th{color:var(--soft);font-weight:600;border-bottom:1px solid var(--rule)}\
td.n,th.n{text-align:right}tr+tr td{border-top:1px solid var(--rule)}th span{font-weight:400}caption{text-align:left;color:var(--soft);padding-bottom:4px}\
figure{margin:14px 0 20px}figcaption{color:var(--soft);font-size:14.5px;max-width:90ch}svg{display:block;width:100%;height:auto}\
.row{display:grid;gap:18px}.row figure{margin:0}.c2{grid-template-columns:repeat(2,1fr)}.c3{grid-template-columns:repeat(3,1fr)}\
@media(max-width:760px){.c2,.c3{grid-template-columns:1fr}}\
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(128px,1fr));gap:12px;margin:18px 0}\
.tile{background:var(--panel);border:1px solid var(--rule);border-radius:8px;padding:10px 12px;line-height:1.35}\
.tile b{display:block;font-size:23px;line-height:1.3;font-variant-numeric:tabular-nums}.tile span{color:var(--soft);font-size:13.5px}",
    );
    sheet.push_str(FIGURES);
    sheet.push_str(&inks());
    sheet
}
