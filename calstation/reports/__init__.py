"""Documents created from finished results: labels and certificates.

Code that computes or evaluates values belongs in `calstation.results`. The package has more than 15 modules, one for
each part of a certificate, each of its file formats, and each step from its issue to its verification.
"""

from calstation.reports.content import Certificate, build_certificate, certificate_number
from calstation.reports.dcc import write_dcc
from calstation.reports.issue import (
    IssueState,
    certificate_folder,
    issue_certificate,
    issue_certificates,
    issue_report,
    issue_state,
    states_of_issue,
)
from calstation.reports.issued_pdf import IssuedCertificate, IssuedPdf, issued_certificates
from calstation.reports.label import PrintedLabels, label_template, print_label, print_labels, product_label
from calstation.reports.pdf import compile_template
from calstation.reports.request import ReportRequest, station_request
from calstation.reports.time_stamp import stamp_trail, verify_time_stamp
from calstation.reports.verification import (
    CertificateState,
    is_searched,
    read_verified_trail,
    verify_certificate,
    verify_reports,
)
