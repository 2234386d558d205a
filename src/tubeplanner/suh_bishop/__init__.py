"""Phase 2 as published in 1988: knots moved in discrete directions, and doubled."""
