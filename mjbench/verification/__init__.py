"""Every way of stepping one model: agreement first, then speed."""
