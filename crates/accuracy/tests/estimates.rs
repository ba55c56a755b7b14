//! What a solve tells of its error holds.

use accuracy::estimates::estimates;

#[test]
fn measured_errors_are_true_from_easy_to_nearly_unstable() {
    let found = estimates(|_| ()).unwrap();
    assert!(found.cases.len() >= 40);
    for case in &found.cases {
        // What was asked holds, unless the solve went to another equilibrium than its own continuation.
        let holds = case.measured.true_error <= 1.5 * case.asked;
        assert!(holds || case.measured.estimated.is_none(), "{case:?}");
    }
    assert!(found.share_within >= 0.95, "{}", found.share_within);
}
