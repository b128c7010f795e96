//! Promises of a report: well-formed, alone, the same bytes, small.

use crate::{
    Axis, Bars, Boxes, Cells, Cloud, Figure, Ink, LinePlot, MapPicture, Overlay, Picture, Report, Scatter,
    Shade, Span, Spread, Strip, Table,
};
use serde_json::json;

/// Numbers that look like measurements, from a seed.
fn noise(seed: u64, count: usize) -> Vec<f64> {
    let mut state = seed;
    let mut draw = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f64 / 16_777_216.0
    };
    (0..count).map(|_| draw() * draw() * 0.4 - 0.1).collect()
}

fn map() -> Figure {
    let shades =
        (0..28 * 28).map(|i| if i % 9 == 0 { Shade::Unknown } else { Shade::Filled(i as f32 / 784.0) });
    let cells =
        Cells { side: 28, cell_m: 0.1, rear_m: -0.4, right_m: -1.4, limit: 0.4, shades: shades.collect() };
    let bend: Vec<_> = (0..20).map(|i| (0.1 * f64::from(i), 0.002 * f64::from(i * i))).collect();
    let overlays = vec![
        Overlay::Footprint(vec![(0.14, 0.28), (-0.14, 0.28), (-0.14, -0.28), (0.14, -0.28)]),
        Overlay::Goal(1.8, 0.6),
        Overlay::Line(bend.clone(), Ink::Blue, true),
        Overlay::Arrow(bend, Ink::Vermilion, 4.0),
        Overlay::Arrow(vec![(0.0, 0.0)], Ink::Green, 2.0),
    ];
    let (title, subtitle) = ("12.3 s <&> \"quoted\"".into(), "regret 0.3".into());
    MapPicture { title, subtitle, cells, overlays, notes: vec![(Ink::Blue, "a & b".into())] }
        .figure()
        .unwrap()
}

/// Every kind of element, with this many points in each.
fn long_report(count: usize) -> Report {
    let time = |i: usize| i as f64 / 30.0;
    let line = |seed: u64| noise(seed, count).into_iter().enumerate().map(|(i, y)| (time(i), y)).collect();
    let pairs: Vec<_> = noise(3, count).into_iter().zip(noise(4, count)).collect();
    let mut report =
        Report::new("A & B", "made of </script> and <!-- noise", json!({"text": "</script><!--"}));
    report.heading("Everything");
    report.paragraph("Text.");
    report.warning("Cut.");
    report.tiles(&[("93 %".into(), "agreement".into())]);
    let mut table = Table::new("Errors", &[("what", ""), ("mean", "m/s")]);
    table.row(["policy", "0.012"]);
    report.table(&table);
    let plot = LinePlot::new("error", Axis::new("time", "s"), Axis::new("error", "m/s"))
        .series("v", Ink::Blue, line(1))
        .series("w", Ink::Vermilion, line(2))
        .mark(0.09, "0.09 m/s");
    report.figure(&plot.figure().caption("over time"));
    let spread = |seed| Spread::of(noise(seed, count.max(1))).unwrap();
    let boxes = vec![("v".into(), Ink::Blue, spread(5)), ("w".into(), Ink::Vermilion, spread(6))];
    let boxes = Boxes { title: "boxes".into(), y: Axis::new("error", "m/s"), boxes, marks: vec![] };
    let histogram = Bars::histogram("regret", &noise(7, count), &Axis::new("regret", "1"), 40, Ink::Green);
    report.figures(&[boxes.figure(), histogram], 2);
    let bars = vec![("slowed".into(), Ink::Orange, 3.5), ("stopped".into(), Ink::Grey, 1.0)];
    let bars = Bars { title: "seconds".into(), amount: Axis::new("time", "s"), bars };
    report.figure(&bars.figure());
    let cloud = Cloud { name: "frames".into(), ink: Ink::Purple, points: pairs.clone(), joined: false };
    let way = Cloud { name: "way".into(), ink: Ink::Grey, points: pairs, joined: true };
    let (x, y) = (Axis::new("doubt", "m/s"), Axis::new("error", "m/s"));
    let title = String::from("doubt");
    let scatter = Scatter {
        title,
        x,
        y,
        clouds: vec![cloud],
        guide: Some((vec![(0.0, 0.0), (0.1, 0.1)], "equal".into())),
        equal: false,
    };
    report.figure(&scatter.figure());
    report.figure(&Scatter { equal: true, clouds: vec![way], ..scatter }.figure());
    let spans =
        (0..count).map(|i| Span { from: time(i), to: time(i + 1), ink: [Ink::Blue, Ink::Green][i % 2] });
    let rows = vec![("who".into(), spans.collect())];
    let meanings = vec![("policy".into(), Ink::Blue), ("expert".into(), Ink::Green)];
    let strip = Strip { title: "who drove".into(), x: Axis::new("time", "s"), rows, meanings };
    report.figure(&strip.figure());
    report.figures(&[map(), map(), map()], 3);
    let picture =
        Picture { title: "depth".into(), width: 2, height: 2, rgba: vec![9; 16], shown_width: 100.0 };
    report.figure(&picture.figure().unwrap());
    report
}

/// Fails where tags are not closed in order, attributes are not quoted, or text holds a bare `<` or `&`.
fn check_well_formed(text: &str) {
    const VOID: [&str; 3] = ["meta", "!doctype", "br"];
    let mut open: Vec<&str> = Vec::new();
    let mut rest = text;
    while let Some(start) = rest.find('<') {
        check_entities(&rest[..start]);
        let tag = &rest[start + 1..];
        let end = tag.find('>').expect("a tag ends");
        let (inner, after) = (&tag[..end], &tag[end + 1..]);
        assert_eq!(inner.matches('"').count() % 2, 0, "attribute without its end: {inner}");
        assert!(!inner.contains('<'), "bare < near {inner}");
        if let Some(name) = inner.strip_prefix('/') {
            assert_eq!(open.pop(), Some(name), "closed out of order");
        } else if !inner.ends_with('/') {
            let name = inner.split_whitespace().next().unwrap();
            if !VOID.contains(&name) {
                open.push(name);
            }
            if name == "script" || name == "style" {
                let close = after.find(&format!("</{name}>")).expect("raw text ends");
                rest = &after[close..];
                continue;
            }
        }
        rest = after;
    }
    assert!(open.is_empty(), "left open: {open:?}");
}

fn check_entities(text: &str) {
    for (at, _) in text.match_indices('&') {
        let known = ["&amp;", "&lt;", "&gt;", "&quot;"];
        assert!(known.iter().any(|entity| text[at..].starts_with(entity)), "bare & in {text}");
    }
}

#[test]
fn a_page_and_its_figures_are_well_formed_whatever_the_text_says() {
    check_well_formed(&long_report(500).html());
    check_well_formed(&map().svg());
    check_well_formed(&Figure::sheet("two", &[map(), map(), map()], 2).svg());
    check_well_formed(&long_report(0).html());
}

#[test]
fn the_numbers_within_are_the_numbers_beside() {
    let report = long_report(10);
    let html = report.html();
    let begin = html.find("id=\"data\">").unwrap() + "id=\"data\">".len();
    let end = begin + html[begin..].find("</script>").unwrap();
    let within: serde_json::Value = serde_json::from_str(&html[begin..end]).unwrap();
    let beside: serde_json::Value = serde_json::from_str(&report.json()).unwrap();
    assert_eq!(within, beside);
    assert_eq!(within["text"], "</script><!--");
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    assert_eq!(long_report(2000).html(), long_report(2000).html());
}

/// An hour at 30 Hz in every plot.
#[test]
fn a_long_recording_makes_a_page_below_two_megabytes() {
    let bytes = long_report(108_000).html().len();
    assert!(bytes < 2_000_000, "{bytes} bytes");
}

#[test]
fn a_page_needs_nothing_from_outside() {
    let html = long_report(100).html();
    for word in ["http:", "https:", "src=", "@import", "url(", "<link"] {
        assert!(!html.contains(word), "{word}");
    }
}

#[test]
fn not_a_number_is_never_written() {
    let points = vec![(0.0, f64::NAN), (1.0, f64::INFINITY), (2.0, 0.5)];
    let plot = LinePlot::new("gaps", Axis::new("time", "s"), Axis::new("error", "m/s")).series(
        "v",
        Ink::Blue,
        points.clone(),
    );
    let cloud = Cloud { name: "c".into(), ink: Ink::Sky, points, joined: false };
    let (x, y) = (Axis::new("a", ""), Axis::new("b", ""));
    let scatter = Scatter { title: String::new(), x, y, clouds: vec![cloud], guide: None, equal: true };
    for figure in [plot.figure(), scatter.figure()] {
        assert!(!figure.svg().contains("NaN") && !figure.svg().contains("inf"), "{}", figure.svg());
    }
}
