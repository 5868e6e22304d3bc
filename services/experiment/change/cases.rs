//! What is changed, and what the prototype of the method made of it.

/// Colours of the curves, in the order of the cases.
pub const COLOURS: [&str; 8] =
    ["#888888", "#0072b2", "#56b4e9", "#009e73", "#d55e00", "#e69f00", "#cc79a7", "#8c6bb1"];

/// One change of the cell.
pub struct Case {
    /// As the table and `--scenes` name it.
    pub name: &'static str,
    mount_deg: f64,
    focal_factor: f64,
    forearm_factor: f64,
    /// Moves to 3 cm and 1 cm, median / p90, of the kinematic prototype (design notes on the learner,
    /// sections 4.1 and 4.3), whose camera saw 0.64 m of the table.
    pub prototype_at_start: &'static str,
    /// The same where the change comes after 25 moves, and the error after 1, 2, 5, 10, 20 further ones.
    pub prototype_in_the_middle: &'static str,
}

const fn case(name: &'static str, change: [f64; 3], prototype: [&'static str; 2]) -> Case {
    Case {
        name,
        mount_deg: change[0],
        focal_factor: change[1],
        forearm_factor: change[2],
        prototype_at_start: prototype[0],
        prototype_in_the_middle: prototype[1],
    }
}

/// In training.
pub const TRAINING: [Case; 8] = [
    case("none", [0.0, 1.0, 1.0], ["3/5, 9/15", "1/1, 1/1: .35 .35 .33 .29 .26 cm"]),
    case("turn-20", [20.0, 1.0, 1.0], ["3/4, 9/13", "2/4, 6/10: 6.9 1.9 1.1 .56 .34 cm"]),
    case("turn-90", [90.0, 1.0, 1.0], ["3/4, 9/13", "4/7, 10/14: 6.7 5.1 2.1 .93 .44 cm"]),
    case("turn-180", [180.0, 1.0, 1.0], ["3/4, 9/13", "5/8, 13/19: 9.8 7.8 2.5 1.2 .60 cm"]),
    case("focal-2", [0.0, 2.0, 1.0], ["2/3, 4/6", "2/5, 5/9: 11 1.8 .81 .31 .14 cm"]),
    case("focal-0.5", [0.0, 0.5, 1.0], ["9/13, never", "8/15, never: 19 13 5.6 2.6 1.4 cm"]),
    case("forearm-1.2", [0.0, 1.0, 1.2], ["3/5, 10/-", "2/5, 5/12: 4.1 1.9 1.1 .78 .58 cm"]),
    case("forearm-0.8", [0.0, 1.0, 0.8], ["3/6, 12/-", "3/10, 10/18: 4.3 4.2 1.5 .98 .64 cm"]),
];

/// While following; of the prototype the RMS in the windows after the change (design notes on the learner,
/// section 7, its last window 25-35 s), the share out of view, the share under 2 cm.
pub const KNOCKS: [Case; 5] = [
    case("none", [0.0, 1.0, 1.0], ["", ".62 .61 .61 .62 .64 cm, 0 %, 100 %"]),
    case("turn-20", [20.0, 1.0, 1.0], ["", ".93 .77 .70 .66 .65 cm, 0 %, 100 %"]),
    case("turn-45", [45.0, 1.0, 1.0], ["", "2.7 3.1 2.5 1.5 .75 cm, 0 %, 100 %"]),
    case("turn-70", [70.0, 1.0, 1.0], ["", "5.7 4.7 3.3 2.5 1.6 cm, 0 %, 68 %"]),
    case("focal-1.4", [0.0, 1.4, 1.0], ["", ".86 .55 .45 .48 .47 cm, 2 %, 98 %"]),
];

impl Case {
    /// Whether it is among `names`; no names are all.
    pub fn is_wanted(&self, names: &[String]) -> bool {
        names.is_empty() || names.iter().any(|name| name == self.name)
    }

    /// Settings of section `[change]`.
    pub fn settings(&self, when: &str, after: f64) -> Vec<String> {
        vec![
            format!("change.when={when}"),
            format!("change.after={after}"),
            format!("change.mount_deg={:?}", self.mount_deg),
            format!("change.focal_factor={:?}", self.focal_factor),
            format!("change.forearm_factor={:?}", self.forearm_factor),
        ]
    }
}

/// Nothing, where there are cases of these names.
///
/// # Errors
/// In words, for the first name that no case has.
pub fn check(names: &[String]) -> Result<(), String> {
    let known: Vec<&str> = TRAINING.iter().chain(&KNOCKS).map(|case| case.name).collect();
    match names.iter().find(|name| !known.contains(&name.as_str())) {
        Some(name) => Err(format!("there is no change {name:?}; there are {}", known.join(", "))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_are_chosen_by_name_and_unknown_names_are_refused() {
        let names = ["turn-45".to_owned()];
        assert!(check(&names).is_ok() && check(&["turn-46".to_owned()]).is_err());
        assert_eq!(TRAINING.iter().chain(&KNOCKS).filter(|case| case.is_wanted(&names)).count(), 1);
        assert_eq!(KNOCKS.iter().filter(|case| case.is_wanted(&[])).count(), KNOCKS.len());
    }

    #[test]
    fn settings_of_every_case_are_a_valid_config() {
        for (case, when) in TRAINING.iter().map(|c| (c, "move")).chain(KNOCKS.iter().map(|c| (c, "tracking")))
        {
            let document = crate::check::document(None, &case.settings(when, 10.0)).unwrap();
            let change = crate::check::all(&document).unwrap().simulator.cell.change;
            assert!((change.mount_rad.to_degrees() - case.mount_deg).abs() < 1e-9);
            assert_eq!(
                (change.focal_factor, change.forearm_factor),
                (case.focal_factor, case.forearm_factor)
            );
        }
    }
}
