"""Encore, a shading-reuse renderer for OpenUSD.

Importing it registers the schema of Encore's own attributes with USD, so import it before the first
stage is opened if EncorePrimvarsAPI is to be applied or validated. Rendering does not depend on that.
"""

from encore import schema

__version__ = "0.1.0"

schema.register()
