//! Navigation in closed loop, measured: unseen rooms under every lead, and the counterparts of the paper's Figs. 7, 8, 9.

mod beside;
mod corridor;
mod drawing;
mod error;
mod ledger;
mod long;
mod page;
mod pilot;
mod reference;
mod room;
mod statistics;
mod sudden;
mod suite;
mod tuning;

pub use beside::{Apart, Beside, BesideDrive, DRIVERS, beside};
pub use corridor::{
    CORRIDOR_M, Contrast, Corridor, CorridorOptions, Corridors, DENSITY, FIRST_SEED, FREE_WAY_M, LEGS,
    LIMIT_S, LOCALISED_TICKS, PROGRESS_M, PUT_M, Patrol, SEEDS, SIGHT, STUCK_S, TRAININGS, corridors,
    crowded,
};
pub use error::NavigateError;
pub use ledger::{Account, Contact, Ledger, Tally};
pub use long::{LongOptions, RECKLESS, behaviour, long};
pub use page::Navigation;
pub use pilot::{Conditions, Driven, Ending};
pub use room::{Course, GRADES, Grade, SIZE_M, WAY_M, room};
pub use statistics::sign_flip_test;
pub use sudden::{Sudden, View, sudden};
pub use suite::{Failure, GradeShare, Group, Suite, SuiteOptions, drive_courses, rooms};
pub use tuning::{TUNING_SEED, Trial, tune};
