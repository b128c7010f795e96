//! Comparisons as a user makes them: a drive recorded, compared, drawn, mined; and files that cannot be compared.

use crate::harness::{Alone, Folder, run, run_with_summary};

#[test]
fn a_recorded_drive_is_compared_drawn_and_mined_into_samples_that_train() {
    let _alone = Alone::wait();
    let folder = Folder::new("compare");
    let path = |name: &str| folder.join(name).display().to_string();
    let (outcome, summary) = run_with_summary(
        "compared",
        &[
            "run",
            "sim",
            "--for",
            "3s",
            "--record",
            &path("recordings"),
            "--set",
            "supervision.start_ms=60000",
        ],
    );
    assert_eq!(outcome.code, 0, "{}{}", outcome.out, outcome.err);
    let recording = summary["recording"].as_str().unwrap();
    let (html, json, svg, out) =
        (path("report.html"), path("report.json"), path("picture.svg"), path("mined"));
    let compared = run(&[
        "compare", recording, "--html", &html, "--json", &json, "--svg", &svg, "--mine", "20", "--out", &out,
    ]);
    assert_eq!(compared.code, 0, "{}{}", compared.out, compared.err);
    assert!(compared.out.contains("agreement") && compared.out.contains("regret dJ"), "{}", compared.out);
    let page = std::fs::read_to_string(&html).unwrap();
    assert!(page.contains("Optimality gap") && page.contains("data:image/png") && page.len() < 2_000_000);
    assert!(std::fs::read_to_string(&svg).unwrap().starts_with("<svg"));
    let figures: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&json).unwrap()).unwrap();
    let frames = figures["figures"]["frames"].as_u64().unwrap();
    // Beside other work a drive of 3 s takes longer to end.
    assert!((40..=150).contains(&frames), "{frames} frames of 3 s");
    assert_eq!(figures["frames"]["regret"].as_array().unwrap().len() as u64, frames);
    // The samples are a data set like any other.
    let info = run(&["dataset", "info", &out]);
    assert!(
        info.code == 0 && info.out.contains("records      20: 0 made-up maps, 20 frames"),
        "{}{}",
        info.out,
        info.err
    );
    let trained = run(&["train", &out, "--out", &path("model.onnx"), "--samples", "128"]);
    assert_eq!(trained.code, 0, "{}{}", trained.out, trained.err);
    // A second time it is refused, and a recording against itself agrees in everything.
    let again = run(&["compare", recording, "--mine", "20", "--out", &out]);
    assert_eq!(again.code, 2, "{}", again.out);
    assert!(again.err.contains("exists and is not overwritten"), "{}", again.err);
    let itself = run(&["compare", recording, recording]);
    assert_eq!(itself.code, 0, "{}", itself.err);
    assert!(itself.out.contains("A against B") && itself.out.contains("100.0 % of frames"), "{}", itself.out);
}

#[test]
fn what_cannot_be_compared_is_refused_with_a_reason() {
    let folder = Folder::new("incomparable");
    let walk = folder.join("walk.mcap").display().to_string();
    assert_eq!(run(&["import", "tests/data/hololens", &walk, "--rate", "10"]).code, 0);
    let notes = folder.write("notes.mcap", "no recording");
    let cases: [(&[&str], i32, &str); 6] = [
        (&["compare", &walk], 3, "robot.toml is not in it"),
        (&["compare", &notes], 3, "not an MCAP file"),
        (&["compare", "nowhere.mcap"], 3, "give the path of an .mcap"),
        (&["compare", &notes, "--mine", "5"], 2, "--out"),
        (&["compare", &notes, "--mine", "0", "--out", "x"], 2, "needed: 1 to 100000"),
        (&["compare", &notes, "--worst", "1000"], 2, "at most 120"),
    ];
    for (arguments, code, needed) in cases {
        let outcome = run(arguments);
        assert!(outcome.code == code && outcome.err.contains(needed), "{arguments:?}: {outcome:?}");
    }
}
