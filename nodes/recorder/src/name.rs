//! The name of a recording, and the class of its machine.

/// `YYYYMMDD-HHMMSS` for a wall time, in UTC.
pub(crate) fn date_time(wall_ns: u64) -> String {
    let seconds = wall_ns / 1_000_000_000;
    let (day, second) = (seconds / 86_400, seconds % 86_400);
    let (year, month, day) = civil(day);
    let (hour, minute, second) = (second / 3600, second / 60 % 60, second % 60);
    format!("{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}")
}

/// Year, month and day of a day counted from 1970-01-01 (H. Hinnant, days from civil, for years from 1970 on).
fn civil(day: u64) -> (u64, u64, u64) {
    let day = day + 719_468;
    let (era, day_of_era) = (day / 146_097, day % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day_of_month = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    (year_of_era + 400 * era + u64::from(month <= 2), month, day_of_month)
}

/// Machines of one class compute the same bytes: those with fused multiply-add, and those without.
#[must_use]
pub fn kernel_class() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    if !std::arch::is_x86_feature_detected!("fma") {
        return "no-fma";
    }
    "fma"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_follow_the_calendar() {
        for (seconds, name) in [
            (0, "19700101-000000"),
            (951_782_400, "20000229-000000"),
            (1_782_907_199, "20260701-115959"),
            (4_107_542_399, "21000228-235959"),
        ] {
            assert_eq!(date_time(seconds * 1_000_000_000), name);
        }
    }
}
