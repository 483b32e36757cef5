<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="zh_CN">
<context>
    <name>CapabilityView</name>
    <message>
        <source>Process capability by parameter</source>
        <extracomment>Smallest capability index that is usually required. Standard deviations around the mean in which the normal distribution is drawn.</extracomment>
        <translation>各参数的过程能力</translation>
    </message>
    <message>
        <source>Mean</source>
        <translation>均值</translation>
    </message>
    <message>
        <source>σ within</source>
        <translation>组内 σ</translation>
    </message>
    <message>
        <source>σ overall</source>
        <translation>总体 σ</translation>
    </message>
    <message>
        <source>Unit</source>
        <translation>单位</translation>
    </message>
    <message>
        <source>Outside</source>
        <translation>超限数</translation>
    </message>
    <message>
        <source>Normal</source>
        <translation>正态</translation>
    </message>
    <message>
        <source>Cp and Cpk compare the limits with the scatter from run to run, Pp and Ppk with that of all runs. The tooltip of an index shows its 95 % confidence interval. Usually at least {0:g} is required.</source>
        <translation>Cp、Cpk 按相邻标定间的散布计算，Pp、Ppk 按全部标定的散布计算。指针停在指数上可看 95 % 置信区间。通常要求不低于 {0:g}。</translation>
    </message>
    <message>
        <source>yes</source>
        <translation>是</translation>
    </message>
    <message>
        <source>no</source>
        <translation>否</translation>
    </message>
    <message>
        <source>Normal distribution: p = {0:.2g}</source>
        <translation>正态分布检验：p = {0:.2g}</translation>
    </message>
</context>
<context>
    <name>ControlCharts</name>
    <message>
        <source>run</source>
        <extracomment>The chart at the bottom. Largest number of runs whose points are drawn one by one, and of marks at runs that signal. Of more runs, the extremes in each pixel are drawn; of more marks, every n-th. Width of the left axes, px. Number of these units in one of the charts.</extracomment>
        <translation>序号</translation>
    </message>
    <message>
        <source>EWMA, λ = {0:g}, L = {1:g}</source>
        <translation>EWMA，λ = {0:g}，L = {1:g}</translation>
    </message>
    <message>
        <source>CUSUM, k = {0:g} σ, h = {1:g} σ</source>
        <translation>CUSUM，k = {0:g} σ，h = {1:g} σ</translation>
    </message>
    <message>
        <source>; </source>
        <translation>；</translation>
    </message>
    <message>
        <source>{0}: individuals, ±{1:g} σ, Nelson&apos;s rules; {2}</source>
        <translation>{0}：单值图，±{1:g} σ，Nelson 准则；{2}</translation>
    </message>
    <message>
        <source>Moving range of two runs</source>
        <translation>相邻两次的移动极差</translation>
    </message>
</context>
<context>
    <name>ControlView</name>
    <message>
        <source>Chart of slow changes</source>
        <extracomment>Largest number of signalling runs that are listed, the latest first. Number of rows that determine the width of a column. Number of the latest runs whose signals make a quantity notable. Of the selected quantity, see `Charts.signals`.</extracomment>
        <translation>缓变控制图</translation>
    </message>
    <message>
        <source>Quantities and their signals</source>
        <translation>各量及其报警</translation>
    </message>
    <message>
        <source>Runs that signal, the latest first</source>
        <translation>触发报警的标定，最新在前</translation>
    </message>
    <message>
        <source>Runs</source>
        <translation>标定次数</translation>
    </message>
    <message>
        <source>Signals</source>
        <translation>报警数</translation>
    </message>
    <message>
        <source>Run</source>
        <translation>序号</translation>
    </message>
    <message>
        <source>Started</source>
        <translation>开始时间</translation>
    </message>
    <message>
        <source>Signal</source>
        <translation>报警</translation>
    </message>
</context>
<context>
    <name>DailyYield</name>
    <message>
        <source>yield, %</source>
        <translation>合格率，%</translation>
    </message>
</context>
<context>
    <name>Histogram</name>
    <message>
        <source>runs</source>
        <translation>次数</translation>
    </message>
</context>
<context>
    <name>Pareto</name>
    <message>
        <source>runs</source>
        <translation>次数</translation>
    </message>
</context>
<context>
    <name>PlanForm</name>
    <message>
        <source>serial numbers, separated by commas</source>
        <translation>序列号，用逗号分隔</translation>
    </message>
    <message>
        <source>Units</source>
        <translation>产品</translation>
    </message>
    <message>
        <source>Trials</source>
        <translation>次数</translation>
    </message>
    <message>
        <source>Save plan…</source>
        <translation>保存计划…</translation>
    </message>
    <message>
        <source>Close</source>
        <translation>关闭</translation>
    </message>
    <message>
        <source>Operators</source>
        <translation>操作员</translation>
    </message>
    <message>
        <source>names, or empty</source>
        <translation>名称，可留空</translation>
    </message>
    <message>
        <source>Stations</source>
        <translation>工位</translation>
    </message>
</context>
<context>
    <name>QualityPage</name>
    <message>
        <source>The result was not opened</source>
        <extracomment>Numbers of past days that can be chosen; None for all. Views that do not show the summary yet.</extracomment>
        <translation>结果未能打开</translation>
    </message>
    <message>
        <source>The runs could not be read</source>
        <translation>无法读取标定记录</translation>
    </message>
    <message>
        <source>Product</source>
        <translation>产品</translation>
    </message>
    <message>
        <source>Units</source>
        <translation>范围</translation>
    </message>
    <message>
        <source>Time</source>
        <translation>时间</translation>
    </message>
    <message>
        <source>Shown as</source>
        <translation>显示为</translation>
    </message>
    <message>
        <source>All units, the last run of each</source>
        <translation>全部产品，取各自最后一次</translation>
    </message>
    <message>
        <source>Check standard {0}</source>
        <translation>标准件 {0}</translation>
    </message>
    <message>
        <source>Control charts</source>
        <translation>控制图</translation>
    </message>
    <message>
        <source>Capability</source>
        <translation>过程能力</translation>
    </message>
    <message>
        <source>Yield</source>
        <translation>合格率</translation>
    </message>
    <message>
        <source>Check standards</source>
        <translation>标准件</translation>
    </message>
    <message>
        <source>Repeatability</source>
        <translation>重复性研究</translation>
    </message>
    <message>
        <source>Last {0} days</source>
        <translation>最近 {0} 天</translation>
    </message>
    <message>
        <source>Any time</source>
        <translation>不限时间</translation>
    </message>
    <message>
        <source>Last 24 hours</source>
        <translation>最近 24 小时</translation>
    </message>
    <message>
        <source>Value</source>
        <translation>数值</translation>
    </message>
    <message>
        <source>Deviation in σ</source>
        <translation>以 σ 为单位的偏差</translation>
    </message>
    <message>
        <source>Deviations of runs of several schedules are comparable:</source>
        <translation>不同标定流程的偏差可以相互比较：</translation>
    </message>
    <message>
        <source>all units: (value − mean) / √(σ² of the run + σ² between units)</source>
        <translation>全部产品：（数值 − 均值）/ √（本次标定的 σ² + 产品间的 σ²）</translation>
    </message>
    <message>
        <source>check standard: (value − reference) / √(σ² of the run + σ² of the reference + expected change²)</source>
        <translation>标准件：（数值 − 参考值）/ √（本次标定的 σ² + 参考值的 σ² + 预期变化²）</translation>
    </message>
</context>
<context>
    <name>StandardsView</name>
    <message>
        <source>Check standards of the product</source>
        <extracomment>Quantities of the table&apos;s geometry in the order of the plots.</extracomment>
        <translation>该产品的标准件</translation>
    </message>
    <message>
        <source>Runs of the selected one, the latest first</source>
        <translation>选中标准件的标定，最新在前</translation>
    </message>
    <message>
        <source>Instruments of the station</source>
        <translation>工位的仪器</translation>
    </message>
    <message>
        <source>Normalised errors Eₙ of the selected run, and their limit</source>
        <translation>选中标定的归一化误差 Eₙ 及其限值</translation>
    </message>
    <message>
        <source>Geometry of the table: EWMA after {} runs</source>
        <translation>转台几何量：{}次标定之后的 EWMA</translation>
    </message>
    <message>
        <source>Smallest errors that this run detects, {} %</source>
        <translation>本次标定能检出的最小误差（{} %）</translation>
    </message>
    <message>
        <source>Check standards</source>
        <translation>标准件</translation>
    </message>
    <message>
        <source>Runs of the check standard</source>
        <translation>标准件的标定</translation>
    </message>
    <message>
        <source>Instruments</source>
        <translation>仪器</translation>
    </message>
    <message>
        <source>Smallest errors detected</source>
        <translation>可检出的最小误差</translation>
    </message>
    <message>
        <source>State</source>
        <translation>状态</translation>
    </message>
    <message>
        <source>Serial number</source>
        <translation>序列号</translation>
    </message>
    <message>
        <source>Passed</source>
        <translation>合格</translation>
    </message>
    <message>
        <source>Due</source>
        <translation>到期日</translation>
    </message>
    <message>
        <source>Verdict</source>
        <translation>结论</translation>
    </message>
    <message>
        <source>Started</source>
        <translation>开始时间</translation>
    </message>
    <message>
        <source>largest |Eₙ|</source>
        <translation>最大 |Eₙ|</translation>
    </message>
    <message>
        <source>Name</source>
        <translation>名称</translation>
    </message>
    <message>
        <source>Certificate</source>
        <translation>证书编号</translation>
    </message>
    <message>
        <source>Parameter</source>
        <translation>参数</translation>
    </message>
    <message>
        <source>Error</source>
        <translation>误差</translation>
    </message>
    <message>
        <source>Unit</source>
        <translation>单位</translation>
    </message>
    <message>
        <source>of the limit</source>
        <translation>占限值</translation>
    </message>
    <message>
        <source>Nothing is tested yet: {0} of {1} runs of the baseline are missing.</source>
        <translation>尚不检验：基线的 {1} 次标定还缺 {0} 次。</translation>
    </message>
</context>
<context>
    <name>StudyView</name>
    <message>
        <source>Quantity</source>
        <extracomment>State of each verdict. Fields of names in the form of a new plan.</extracomment>
        <translation>量</translation>
    </message>
    <message>
        <source>Open plan…</source>
        <translation>打开计划…</translation>
    </message>
    <message>
        <source>New plan…</source>
        <translation>新建计划…</translation>
    </message>
    <message>
        <source>Run</source>
        <translation>序号</translation>
    </message>
    <message>
        <source>Trial</source>
        <translation>轮次</translation>
    </message>
    <message>
        <source>Unit</source>
        <translation>产品</translation>
    </message>
    <message>
        <source>Operator</source>
        <translation>操作员</translation>
    </message>
    <message>
        <source>Station</source>
        <translation>工位</translation>
    </message>
    <message>
        <source>State</source>
        <translation>状态</translation>
    </message>
    <message>
        <source>Runs of the plan</source>
        <translation>计划中的标定</translation>
    </message>
    <message>
        <source>Variation</source>
        <translation>变差</translation>
    </message>
    <message>
        <source>95 % interval</source>
        <translation>95 % 置信区间</translation>
    </message>
    <message>
        <source>% of study</source>
        <translation>占研究总变差 %</translation>
    </message>
    <message>
        <source>% of tolerance</source>
        <translation>占限差 %</translation>
    </message>
    <message>
        <source>Components of the variation</source>
        <translation>变差分量</translation>
    </message>
    <message>
        <source>Source</source>
        <translation>来源</translation>
    </message>
    <message>
        <source>Degrees of freedom</source>
        <translation>自由度</translation>
    </message>
    <message>
        <source>Analysis of variance</source>
        <translation>方差分析</translation>
    </message>
    <message>
        <source>Open the plan of a study</source>
        <translation>打开研究计划</translation>
    </message>
    <message>
        <source>Save the plan</source>
        <translation>保存计划</translation>
    </message>
</context>
<context>
    <name>TableCharts</name>
    <message>
        <source>run</source>
        <translation>序号</translation>
    </message>
</context>
<context>
    <name>YieldView</name>
    <message>
        <source>Yield by product, station and operator</source>
        <extracomment>Largest number of failed checks drawn. Largest number of days that are drawn one by one. Smallest fraction shown on the axis of the yield.</extracomment>
        <translation>按产品、工位和操作员的合格率</translation>
    </message>
    <message>
        <source>By</source>
        <translation>分组</translation>
    </message>
    <message>
        <source>Name</source>
        <translation>名称</translation>
    </message>
    <message>
        <source>Passed</source>
        <translation>合格</translation>
    </message>
    <message>
        <source>Runs</source>
        <translation>标定次数</translation>
    </message>
    <message>
        <source>Yield</source>
        <translation>合格率</translation>
    </message>
    <message>
        <source>95 % interval</source>
        <translation>95 % 置信区间</translation>
    </message>
    <message>
        <source>Yield by day, or by week if there are many, with its 95 % interval</source>
        <translation>每日合格率（天数多时按周），含 95 % 置信区间</translation>
    </message>
    <message>
        <source>Failed checks by frequency, and their cumulative share of the failed runs</source>
        <translation>不合格检查按次数排列，及其在不合格标定中的累计占比</translation>
    </message>
    <message>
        <source>Yield {0}</source>
        <translation>合格率 {0}</translation>
    </message>
    <message>
        <source>First pass {0}</source>
        <translation>一次合格率 {0}</translation>
    </message>
    <message>
        <source>Product</source>
        <translation>产品</translation>
    </message>
    <message>
        <source>Station</source>
        <translation>工位</translation>
    </message>
    <message>
        <source>Operator</source>
        <translation>操作员</translation>
    </message>
</context>
</TS>
