//! What was measured as a block of a robot file.

use crate::identification::Identification;

/// Keys of the block, in the order of the files that are shipped.
const KEYS: [&str; 9] = [
    "dead_time_min_s",
    "dead_time_max_s",
    "lag_s",
    "brake_min_m_s2",
    "brake_max_m_s2",
    "tracking_m_s",
    "tracking_rad_s",
    "watchdog_s",
    "pitch_rad_per_m_s2",
];

/// The `[actuator]` block of `robot_text` with what was measured in place of what it has; what these tests cannot tell
/// keeps its value and its source. Rounded so that the set contains every test.
#[must_use]
pub fn actuator_block(found: &Identification, robot_text: &str) -> String {
    let file: toml::Table = robot_text.parse().unwrap_or_default();
    let actuator = file.get("actuator").and_then(toml::Value::as_table).cloned().unwrap_or_default();
    let source = format!("measured: sidestep identify, {} steps", found.tests.len());
    let mut text = "[actuator]\n".to_owned();
    for key in KEYS {
        let line = match (measured(found, key), actuator.get(key)) {
            (Some(value), _) => format!("{key} = {{ value = {value}, source = \"{source}\" }}\n"),
            (None, Some(kept)) => format!("{key} = {kept}\n"),
            (None, None) => continue,
        };
        text.push_str(&line);
    }
    text
}

/// The value of a key, rounded outward.
fn measured(found: &Identification, key: &str) -> Option<String> {
    let outward = |value: f64, unit: f64, up: bool| {
        let steps = value / unit;
        let whole = if up { (steps - 1e-6).ceil() } else { (steps + 1e-6).floor() };
        format!("{:.3}", whole * unit)
    };
    match key {
        "dead_time_min_s" => found.dead_range_s().map(|range| outward(range.0, 1e-3, false)),
        "dead_time_max_s" => found.dead_range_s().map(|range| outward(range.1, 1e-3, true)),
        "lag_s" => found.lag_s.or(found.turn_lag_s).map(|lag| format!("{:.3}", lag.mean)),
        "brake_min_m_s2" => found.own_brake_m_s2.map(|brake| outward(brake.min, 1e-2, false)),
        "brake_max_m_s2" => found.own_brake_m_s2.map(|brake| outward(brake.max, 1e-2, true)),
        "tracking_m_s" => found.tracking_m_s.map(|error| outward(error.max.max(1e-3), 1e-3, true)),
        "tracking_rad_s" => found.tracking_rad_s.map(|error| outward(error.max.max(1e-3), 1e-3, true)),
        _ => None,
    }
}
