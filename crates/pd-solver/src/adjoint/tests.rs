//! What is called next to singular.

use super::{SOFT, UNIQUE, is_well_conditioned};

/// A soft direction or a rotation that is not unique is enough; what was not met says nothing.
#[test]
fn either_kind_of_singular_state_is_ill_conditioned() {
    let (fine, soft, torn) = (Some(0.3), Some(0.5 * SOFT), Some(0.5 * UNIQUE));
    for firm in [None, fine, Some(2.0 * SOFT)] {
        for unique in [None, fine, Some(2.0 * UNIQUE)] {
            assert!(is_well_conditioned(firm, unique));
        }
    }
    for firm in [None, fine] {
        assert!(!is_well_conditioned(firm, torn));
        assert!(!is_well_conditioned(soft, firm));
    }
    assert!(!is_well_conditioned(soft, torn));
    assert!(!is_well_conditioned(Some(0.0), fine));
    assert!(!is_well_conditioned(fine, Some(0.0)));
    assert!(!is_well_conditioned(Some(f64::NAN), fine));
}
