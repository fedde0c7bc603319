"""Reports: what each verb found, as one `Report`; one file per kind of result, and no numerics in any of them."""
