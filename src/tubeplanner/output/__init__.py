"""Files, controllers, figures, pages; here the data that figures and pages share."""
