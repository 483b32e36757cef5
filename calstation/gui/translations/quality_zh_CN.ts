<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>CapabilityView</name>
    <message>
        <source>Process capability by parameter</source>
        <extracomment>Smallest capability index that is usually required. Standard deviations around the mean in which the normal distribution is drawn.</extracomment>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Runs</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Mean</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>σ within</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>σ overall</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Unit</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Outside</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Normal</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Cp and Cpk compare the limits with the scatter from run to run, Pp and Ppk with that of all runs. The tooltip of an index shows its 95 % confidence interval. Usually at least {0:g} is required.</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>yes</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>no</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Normal distribution: p = {0:.2g}</source>
        <translation type="unfinished"></translation>
    </message>
</context>
<context>
    <name>ControlCharts</name>
    <message>
        <source>range</source>
        <extracomment>The chart at the bottom. Largest number of runs whose points are drawn one by one. Width of the left axes, px. Number of these units in one of the charts.</extracomment>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>run</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>EWMA, λ = {0:g}, L = {1:g}</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>CUSUM, k = {0:g} σ, h = {1:g} σ</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Individuals, limits 3 σ, Nelson&apos;s rules</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Moving range of two runs</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>CUSUM, σ</source>
        <translation type="unfinished"></translation>
    </message>
</context>
<context>
    <name>ControlView</name>
    <message>
        <source>Chart of slow changes</source>
        <extracomment>Largest number of signalling runs that are listed, the latest first. Number of the latest runs whose signals make a quantity notable.</extracomment>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Quantities and their signals</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Runs that signal, the latest first</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Runs</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Signals</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Run</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Started</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Signal</source>
        <translation type="unfinished"></translation>
    </message>
</context>
<context>
    <name>DailyYield</name>
    <message>
        <source>yield, %</source>
        <translation type="unfinished"></translation>
    </message>
</context>
<context>
    <name>Histogram</name>
    <message>
        <source>runs</source>
        <translation type="unfinished"></translation>
    </message>
</context>
<context>
    <name>Pareto</name>
    <message>
        <source>runs</source>
        <translation type="unfinished"></translation>
    </message>
</context>
<context>
    <name>PlanForm</name>
    <message>
        <source>serial numbers, separated by commas</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>names, separated by commas</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Units</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Measured by</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Names</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Trials</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Save plan…</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Close</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Operators</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Stations</source>
        <translation type="unfinished"></translation>
    </message>
</context>
<context>
    <name>QualityPage</name>
    <message>
        <source>The runs could not be read</source>
        <extracomment>Numbers of past days that can be chosen; None for all.</extracomment>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Product</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Units</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Time</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Shown as</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>All units, the last run of each</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Check standard {0}</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Control charts</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Capability</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Yield</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Check standards</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Repeatability</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Last {0} days</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Any time</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Last 24 hours</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Value</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>(Value − reference) / σ</source>
        <translation type="unfinished"></translation>
    </message>
</context>
<context>
    <name>StandardsView</name>
    <message>
        <source>Check standards of the product</source>
        <extracomment>Quantities of the table&apos;s geometry in the order of the plots.</extracomment>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Runs of the selected one, the latest first</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Instruments of the station</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Normalised errors Eₙ of the selected run, and their limit</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Geometry of the table, from every run of the product: EWMA and its limits</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Check standards</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Runs of the check standard</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Instruments</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>State</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Serial number</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Passed</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Due</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Verdict</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Started</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>largest |Eₙ|</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Name</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Certificate</source>
        <translation type="unfinished"></translation>
    </message>
</context>
<context>
    <name>StudyView</name>
    <message>
        <source>Quantity</source>
        <extracomment>State of each verdict. Components in the order of the table.</extracomment>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Open plan…</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>New plan…</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Run</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Trial</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Measured by</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Unit</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>State</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Runs of the plan</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Variation</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>95 % interval</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>% of study</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>% of tolerance</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Components of the variation</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Source</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Degrees of freedom</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Analysis of variance</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Open the plan of a study</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Save the plan</source>
        <translation type="unfinished"></translation>
    </message>
</context>
<context>
    <name>TableCharts</name>
    <message>
        <source>run</source>
        <translation type="unfinished"></translation>
    </message>
</context>
<context>
    <name>YieldView</name>
    <message>
        <source>Yield by product, station and operator</source>
        <extracomment>Largest number of failed checks drawn. Largest number of days that are drawn one by one. Smallest fraction shown on the axis of the yield.</extracomment>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>By</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Name</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Passed</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Runs</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Yield</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>95 % interval</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Yield by day (over more than {0} days: by week), with its 95 % interval</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Failed checks by frequency, and their cumulative share of the failed runs</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Yield {0}</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>First pass {0}</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Product</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Station</source>
        <translation type="unfinished"></translation>
    </message>
    <message>
        <source>Operator</source>
        <translation type="unfinished"></translation>
    </message>
</context>
</TS>
