import sys

from curvcasadi.cli.main import main

sys.exit(main())
